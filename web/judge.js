/** What the records of a live page say of its estimators: statistics of the errors, health; as `insenv run` judges them. */

import { healthNotes, healthOf } from "./health.js";
import { significant } from "./numbers.js";
import { filled } from "./words.js";

/**
 * The health of an estimator over the records; null if it tells none, or if nothing was measured.
 * @param {any} live
 * @param {any} estimator  of `live.estimators`
 * @param {(name: string) => any} at
 * @param {import("./history.js").Recorded} history
 * @returns {import("./health.js").Health | null} */
export function healthNow(live, estimator, at, history) {
  if (!estimator.health) return null;
  const { prefix, health } = estimator;
  const sums = (/** @type {string[]} */ names) => {
    const columns = names.flatMap((name, place) => {
      const row = at(prefix + name);
      return Array.from({ length: place < 2 ? 1 : live.rule.groups }, (_, k) =>
        (/** @type {number} */ record) => (k < row.size ? history.value(row.at + k, record) : 0));
    });
    return { records: history.count(), columns };
  };
  const aids = Object.fromEntries(Object.entries(health.aids).map(([id, names]) => [id, sums(names)]));
  return healthOf(live.rule, health.fixes && sums(health.fixes), aids);
}

/**
 * What must be said of a run at its end, as `insenv run` says it.
 * @param {any} live
 * @param {any} estimator  of `live.estimators`
 * @param {(name: string) => any} at
 * @param {import("./history.js").Recorded} history
 * @param {boolean} known  whether the settings are those of the document, on which some of it depends
 * @returns {string[]} */
export function notesAtEnd(live, estimator, at, history, known) {
  const { sentences } = live.rule;
  const notes = known ? foundOf(estimator, at, history) : [];
  const health = healthNow(live, estimator, at, history);
  if (estimator.health?.fixes && !health?.own) notes.push(sentences[health ? "no-fix-but-aids" : "no-fix"]);
  if (health) notes.push(...healthNotes(live.rule, health, !known || estimator.health.slow, estimator.health.causes));
  if (known && estimator.health?.less) notes.push(...countedLess(live.rule, estimator, at, history));
  const left = unjudged(live, estimator, at, history);
  if (left.channels.length) notes.push(filled(sentences["steep-pitch"], { pitch: left.pitch }));
  if (!estimator.settled) return notes;
  const ratios = statisticsOf(estimator, at, history)
    .filter(({ channel }) => !left.channels.includes(channel))
    .filter(({ rms, stated }) => stated && rms > live.rule.too_sure * stated)
    .map(({ channel, rms, stated }) => `${channel.replace(/_.*/, "")} ${significant(rms / (stated ?? NaN), 3)}`);
  if (ratios.length) notes.push(filled(sentences["too-sure"], { ratios: ratios.join(", ") }));
  return notes;
}

/** Whether a filter that does not estimate slow errors of the fixes is worse than one fix: `fixes_count_less` of
 * insenv/evaluation/health.py.
 * @param {{larger: number, sentences: Record<string, string>}} rule
 * @param {any} estimator
 * @param {(name: string) => any} at
 * @param {import("./history.js").Recorded} history
 * @returns {string[]} */
export function countedLess({ larger, sentences }, { prefix }, at, history) {
  const count = (/** @type {number} */ record) => history.value(at(`${prefix}fix_count`).at, record);
  const fixed = Array.from({ length: history.count() }, (_, record) => record).filter((k) => k > 0 && count(k) > count(k - 1));
  const recent = fixed.slice(Math.floor(fixed.length / 2));
  const [own, one] = [at(`${prefix}position_sigma`), at("gnss_position_sigma")].map(({ at: place }) =>
    [0, 1, 2].map((axis) => median(recent.map((record) => history.value(place + axis, record)))),
  );
  const [stated, fix] = own.map((sigma, axis) => [sigma, one[axis]]).reduce((a, b) => (b[0] / b[1] > a[0] / a[1] ? b : a));
  return stated > larger * fix ? [filled(sentences["fixes-count-less"], { stated, fix })] : [];
}

/** @param {number[]} values  empty: NaN
 * @returns {number} */
function median(values) {
  const sorted = [...values].sort((a, b) => a - b);
  const middle = sorted.length / 2;
  return 0.5 * ((sorted[Math.ceil(middle) - 1] ?? NaN) + (sorted[Math.floor(middle)] ?? NaN));
}

/**
 * The largest pitch of a run in degrees, and the errors that are none of the attitude because it comes near 90 deg.
 * @param {any} live
 * @param {any} estimator
 * @param {(name: string) => any} at
 * @param {import("./history.js").Recorded} history
 * @returns {{pitch: number, channels: string[]}} */
export function unjudged(live, estimator, at, history) {
  const pitch = largest(at("attitude").at + 1, at, history, estimator.from_s);
  const steep = estimator.channels.includes("pitch_deg") && pitch > live.rule.steep;
  return { pitch, channels: steep ? ["roll_deg", "heading_deg"] : [] };
}

/** The findings of an estimator that hold: of those about one row, the first (insenv/estimators/contract.py).
 * @param {any} estimator
 * @param {(name: string) => any} at
 * @param {import("./history.js").Recorded} history
 * @returns {string[]} */
function foundOf({ prefix, findings }, at, history) {
  const last = history.count() - 1;
  const byRow = new Map();
  for (const { row, elements, limit, sentence } of findings) {
    const ratios = elements.map(
      (/** @type {number[]} */ [k, about, scale]) => Math.abs(history.value(at(prefix + row).at + k, last) - about) / scale,
    );
    const ratio = Math.max(0, ...ratios);
    if (ratio >= limit && !byRow.has(row)) byRow.set(row, filled(sentence, { ratio: significant(ratio, 3) }));
  }
  return [...byRow.values()];
}

/** The largest magnitude of an output from a time on.
 * @param {number} place
 * @param {(name: string) => any} at
 * @param {import("./history.js").Recorded} history
 * @param {number} from  s */
function largest(place, at, history, from) {
  let found = 0;
  for (let record = 0; record < history.count(); record++) {
    if (history.value(at("time").at, record) >= from - 1e-9) found = Math.max(found, Math.abs(history.value(place, record)));
  }
  return found;
}

/**
 * The errors of an estimator: at the end, and rms, largest and stated rms from `from_s` on.
 * @param {any} estimator
 * @param {(name: string) => any} at
 * @param {import("./history.js").Recorded} history
 * @returns {{channel: string, final: number, rms: number, max: number, stated: number | null}[]} */
export function statisticsOf({ prefix, channels, stated, from_s: from }, at, history) {
  const last = history.count() - 1;
  const time = at("time").at;
  const over = (/** @type {number} */ place) => {
    let [sum, count, max] = [0, 0, 0];
    for (let record = 0; record <= last; record++) {
      if (history.value(time, record) < from - 1e-9) continue;
      const value = history.value(place, record);
      sum += value * value;
      max = Math.max(max, Math.abs(value));
      count++;
    }
    return { rms: Math.sqrt(sum / count), max };
  };
  return channels.map((/** @type {string} */ channel, /** @type {number} */ k) => {
    const place = at(`${prefix}error`).at + k;
    const own = stated.indexOf(channel);
    return {
      channel,
      final: history.value(place, last),
      ...over(place),
      stated: own < 0 ? null : over(at(`${prefix}sigma`).at + own).rms,
    };
  });
}
