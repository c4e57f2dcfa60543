/** What the records of a live page say of its estimators, by the rules of insenv/evaluation, compiled (insenv/web/judging.py). */

import { bytesOf } from "./arrays.js";
import { firstWhere } from "./history.js";
import { significant } from "./numbers.js";
import { filled, worded } from "./words.js";

/**
 * @typedef {import("./history.js").Recorded} Recorded
 * @typedef {object} Health  of an estimator
 * @property {string} verdict
 * @property {string[]} lines
 * @property {Record<string, any> | null} gnss  what is told of the fixes of GNSS; null if there was none
 * @property {Record<string, any>[]} aids  of those that measured
 */

/** @type {any} */
let compiled = null;

/** Make the rules ready; nothing is judged before.
 * @param {{wasm: string}} rules */
export async function loadRules({ wasm }) {
  compiled = /** @type {any} */ (await WebAssembly.instantiate(bytesOf(wasm))).instance.exports;
  compiled.memory.grow(1);
}

/** What a rule gives, by name.
 * @param {{gives: Record<string, string[]>}} rules
 * @param {string} rule
 * @param {...number} values  its arguments
 * @returns {Record<string, number>} */
function evaluate({ gives }, rule, ...values) {
  const from = (compiled.__heap_base.value + 15) & ~15;
  const to = from + 8 * values.length;
  new Float64Array(compiled.memory.buffer, from, values.length).set(values);
  compiled[rule](from, to);
  const numbers = new Float64Array(compiled.memory.buffer, to, gives[rule].length);
  return Object.fromEntries(gives[rule].map((name, place) => [name, numbers[place]]));
}

/** Numbers and as many others behind them as are missing.
 * @param {number[]} values
 * @param {number} size
 * @param {number} other */
function longer(values, size, other) {
  return [...values, ...Array(size - values.length).fill(other)];
}

/**
 * The health of an estimator over the records; null if it tells none, or if nothing was measured.
 * @param {any} live
 * @param {any} estimator  of `live.estimators`
 * @param {Recorded} history
 * @returns {Health | null} */
export function healthNow({ rules }, { prefix, health }, history) {
  if (!health) return null;
  /** @param {string} id @param {string} what @param {string[]} names */
  const toldBy = (id, what, names) => {
    const rows = names.map((name) => history.at(prefix + name));
    const sums = (/** @type {number} */ record) =>
      rows.flatMap((row, place) => {
        const values = Array.from({ length: row.size }, (_, k) => history.value(row.at + k, record));
        return place < 2 ? values : longer(values, rules.sizes.groups, 0);
      });
    const causes = health.causes[id] ?? "";
    const numbers = measured(rules, history.count(), (record) => history.value(rows[0].at, record), sums);
    return numbers && worded(rules.instrument, { id, what, causes, caused: causes ? 1 : 0, ...numbers });
  };
  const gnss = health.fixes && toldBy("", "fixes", health.fixes);
  const aids = Object.entries(health.aids).flatMap(([id, names]) => toldBy(id, "measurements", names) ?? []);
  if (!gnss && !aids.length) return null;
  const all = [gnss ?? { place: 0, ratio: 1 }, ...aids];
  const [places, ratios] = ["place", "ratio"].map((name, other) => longer(all.map((one) => one[name]), rules.sizes.instruments, other));
  const numbers = evaluate(rules, "filter", ...places, ...ratios, gnss?.count ?? 0, 0);
  const { verdict, line } = worded(rules.filter, { ...numbers, of_gnss: gnss?.summary });
  return { verdict, lines: [line, ...aids.map((one) => `${one.id}: ${one.summary}`)], gnss, aids };
}

/** What the rule gives of an instrument: see insenv/evaluation/nis.py; null if nothing was measured.
 * @param {any} rules
 * @param {number} records
 * @param {(record: number) => number} count
 * @param {(record: number) => number[]} sums */
function measured(rules, records, count, sums) {
  const last = records - 1;
  if (last < 0 || !count(last)) return null;
  const firstWith = (/** @type {number} */ some) => firstWhere(last, (record) => count(record) >= some);
  const block = count(last) / rules.blocks;
  const ends = Array.from({ length: rules.blocks }, (_, k) => (block < 2 ? last : firstWith((k + 1) * block)));
  return evaluate(rules, "instrument", ...[...ends, firstWith(rules.late * count(last))].flatMap(sums));
}

/**
 * What must be said of a run at its end, as `insenv run` says it.
 * @param {any} live
 * @param {any} estimator  of `live.estimators`
 * @param {Recorded} history
 * @param {boolean} known  whether the settings are those of the document, on which some of it depends
 * @returns {string[]} */
export function notesAtEnd(live, estimator, history, known) {
  const { rules } = live;
  const notes = known ? foundOf(rules, estimator, history) : [];
  const health = healthNow(live, estimator, history);
  if (estimator.health?.fixes) notes.push(...ofFixes(rules, health, !known || estimator.health.slow));
  const worst = health?.aids.filter((one) => one.wrong) ?? [];
  worst.sort((one, other) => other.ratio - one.ratio || (one.id < other.id ? 1 : -1));
  notes.push(...worst.map((one) => filled(rules["aid-misfit"], one)));
  if (known && estimator.health?.less) notes.push(...countedLess(rules, estimator, history));
  const steep = steepPitch(live, estimator, history);
  if (steep.said) notes.push(filled(rules["steep-pitch"], steep));
  const ratios = statisticsOf(estimator, history)
    .filter(({ channel, stated }) => stated !== null && !steep.channels.includes(channel))
    .map(({ channel, rms, stated }) => ({ what: channel.replace(/_.*/, ""), ...evaluate(rules, "larger_error", rms, stated ?? 0) }))
    .filter((/** @type {any} */ one) => one.said)
    .map((one) => filled(rules.ratio, one));
  if (estimator.settled && ratios.length) notes.push(filled(rules["too-sure"], { ratios: ratios.join(", ") }));
  return notes;
}

/** @param {any} rules
 * @param {Health | null} health
 * @param {boolean} slow  whether the filter models slow errors of the fixes, or it is not known
 * @returns {string[]} */
function ofFixes(rules, health, slow) {
  const { count = 0, place = 0, smaller = 0 } = health?.gnss ?? {};
  const { said } = evaluate(rules, "fixes", count, health ? 1 : 0, place, smaller, slow ? 1 : 0);
  if (!said) return [];
  const aids = health?.aids.map((one) => one.id) ?? [];
  const or_aids = filled(rules.or_aids, { others: aids.length ? 1 : 0, aids: aids.join(", ") });
  return [filled(rules.fixes[said - 1], { ...health?.gnss, or_aids })];
}

/** Whether the position is worse than one fix: see insenv/evaluation/health.py.
 * @param {any} rules
 * @param {any} estimator
 * @param {Recorded} history
 * @returns {string[]} */
function countedLess(rules, { prefix }, history) {
  const count = (/** @type {number} */ record) => history.value(history.at(`${prefix}fix_count`).at, record);
  const fixed = Array.from({ length: history.count() }, (_, record) => record).filter((k) => k > 0 && count(k) > count(k - 1));
  const recent = fixed.slice(Math.floor(fixed.length / 2));
  const medians = ["gnss_position_sigma", `${prefix}position_sigma`].map((name) =>
    [0, 1, 2].map((axis) => median(recent.map((record) => history.value(history.at(name).at + axis, record)))),
  );
  const numbers = evaluate(rules, "counted_less", ...medians[1], ...medians[0]);
  return numbers.said ? [filled(rules["fixes-count-less"], numbers)] : [];
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
 * @param {Recorded} history
 * @returns {{said: number, pitch: number, channels: string[]}} */
export function steepPitch({ rules }, { channels, from_s }, history) {
  const { said, pitch } = evaluate(rules, "steep_pitch", over(history.at("attitude").at + 1, history, from_s).max);
  const steep = channels.includes("pitch_deg") ? said : 0;
  return { said: steep, pitch, channels: steep ? ["roll_deg", "heading_deg"] : [] };
}

/** The findings of an estimator that hold: of those about one row, the first (insenv/estimators/contract.py).
 * @param {any} rules
 * @param {any} estimator
 * @param {Recorded} history
 * @returns {string[]} */
function foundOf(rules, { prefix, findings }, history) {
  const last = history.count() - 1;
  const size = rules.sizes.elements;
  const byRow = new Map();
  for (const { row, elements, limit, sentence } of findings) {
    const [places, about, scale] = [0, 1, 2].map((part) => elements.map((/** @type {number[]} */ one) => one[part]));
    const values = places.map((/** @type {number} */ k) => history.value(history.at(prefix + row).at + k, last));
    const columns = [longer(values, size, 0), longer(about, size, 0), longer(scale, size, 1)];
    const { said, ratio } = evaluate(rules, "departure", ...columns.flat(), limit);
    if (said && !byRow.has(row)) byRow.set(row, filled(sentence, { ratio: significant(ratio, 3) }));
  }
  return [...byRow.values()];
}

/** Root mean square and largest magnitude of an output from a time on.
 * @param {number} place
 * @param {Recorded} history
 * @param {number} from  s */
function over(place, history, from) {
  const time = history.at("time").at;
  let [sum, count, max] = [0, 0, 0];
  for (let record = 0; record < history.count(); record++) {
    if (history.value(time, record) < from - 1e-9) continue;
    const value = history.value(place, record);
    sum += value * value;
    max = Math.max(max, Math.abs(value));
    count++;
  }
  return { rms: Math.sqrt(sum / count), max };
}

/**
 * The errors of an estimator: at the end, and rms, largest and stated rms from `from_s` on.
 * @param {any} estimator
 * @param {Recorded} history
 * @returns {{channel: string, final: number, rms: number, max: number, stated: number | null}[]} */
export function statisticsOf({ prefix, channels, stated, from_s: from }, history) {
  return channels.map((/** @type {string} */ channel, /** @type {number} */ k) => {
    const place = history.at(`${prefix}error`).at + k;
    const own = stated.indexOf(channel);
    return {
      channel,
      final: history.value(place, history.count() - 1),
      ...over(place, history, from),
      stated: own < 0 ? null : over(history.at(`${prefix}sigma`).at + own, history, from).rms,
    };
  });
}
