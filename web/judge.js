/** What the records of a live page say of its estimators: statistics of the errors, health; as `insenv run` judges them. */

import { healthOf } from "./health.js";

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
  const counts = (/** @type {string[]} */ names) => {
    const [count, refused, ...sums] = names.map((name) => at(prefix + name));
    const column = (/** @type {any} */ row, k = 0) => (/** @type {number} */ record) => history.value(row.at + k, record);
    const groups = Array.from({ length: sums[0].size }, (_, k) => {
      const [used, usedNumber, left, leftNumber] = sums.map((row) => column(row, k));
      return { used, usedNumber, left, leftNumber };
    });
    return { records: history.count(), count: column(count), refused: column(refused), groups };
  };
  const aids = Object.fromEntries(Object.entries(health.aids).map(([id, names]) => [id, counts(names)]));
  return healthOf(live.health, health.fixes && counts(health.fixes), aids);
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
