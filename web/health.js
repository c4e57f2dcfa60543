/** Health of a filter from its records: the rule of insenv/evaluation/nis.py and health.py, with the figures of the document.
 * tests/web/test_page_health.py compares both. */

import { chiSquareQuantile } from "./chisquare.js";
import { significant } from "./numbers.js";

/**
 * @typedef {object} Rule  the figures of insenv/evaluation/nis.py
 * @property {[number, number]} probabilities
 * @property {number} blocks
 * @property {number} notable
 * @property {number} many
 * @property {number} most
 * @property {number} apart
 * @property {number} last
 * @property {number} fewest
 * @property {string[]} verdicts  from good to bad
 *
 * @typedef {(record: number) => number} Column
 * @typedef {object} Counts  what a filter reports of one instrument: sums over all measurements so far, at each record
 * @property {number} records
 * @property {Column} count
 * @property {Column} refused
 * @property {{used: Column, usedNumber: Column, left: Column, leftNumber: Column}[]} groups
 *
 * @typedef {{verdict: string, lines: string[]}} Health
 */

/** The health by the fixes of GNSS (null: it takes none) and by other aids; null if nothing was measured.
 * @param {Rule} rule
 * @param {Counts | null} fixes
 * @param {Record<string, Counts>} aids  by id
 * @returns {Health | null} */
export function healthOf(rule, fixes, aids) {
  const own = fixes && judged(rule, fixes, "fixes");
  const others = Object.entries(aids)
    .map(([id, counts]) => ({ id, ...judged(rule, counts, "measurements") }))
    .filter((one) => one.measured);
  const all = [...(own?.measured ? [own] : []), ...others];
  if (!all.length) return null;
  const worst = Math.max(...all.map((one) => rule.verdicts.indexOf(one.verdict)));
  const verdict = rule.verdicts[worst];
  const whole = called(rule, verdict, Math.max(1, ...all.map((one) => one.factor)));
  const named = others.map((one) => `${one.id}: ${one.summary}`);
  if (!own?.measured) return { verdict, lines: [whole, ...named] };
  return { verdict, lines: [verdict === own.verdict ? own.summary : `${whole}; gnss: ${own.summary}`, ...named] };
}

/** @param {Rule} rule
 * @param {Counts} counts
 * @param {string} what */
function judged(rule, counts, what) {
  const end = counts.records - 1;
  const measured = counts.records ? counts.count(end) : 0;
  if (!measured) return { measured, verdict: rule.verdicts[0], factor: 1, summary: "" };
  const whole = nisOf(rule, counts, counts.groups);
  const verdict = verdictOf(rule, counts, whole);
  const ratios = counts.groups.map(
    ({ used, usedNumber, left, leftNumber }) =>
      (used(end) + left(end)) / Math.max(1, usedNumber(end) + leftNumber(end)),
  );
  const factor = verdict === rule.verdicts[0] ? 1 : Math.sqrt(Math.max(...ratios));
  const refused = percent(counts.refused(end), measured);
  const more = verdict === rule.verdicts[0] ? qualified(rule, whole) : "";
  const summary = `${called(rule, verdict, factor)}${more}: ${refused} % of ${measured} ${what} refused, ${nisText(whole)}`;
  return { measured, verdict, factor, summary };
}

/** @param {Rule} rule
 * @param {Counts} counts
 * @param {Nis} whole */
function verdictOf(rule, counts, whole) {
  const [consistent, overconfident, diverged] = rule.verdicts;
  const end = counts.records - 1;
  const [all, refused] = [counts.count(end), counts.refused(end)];
  const late = firstWith(counts, rule.last * all);
  const since = (/** @type {Column} */ column) => column(end) - column(late);
  if (refused > rule.most * all) return diverged;
  const apart = counts.groups.some(({ used, usedNumber }) => since(used) > rule.apart ** 2 * since(usedNumber));
  if (since(counts.count) >= rule.fewest && (since(counts.refused) > rule.most * since(counts.count) || apart)) return diverged;
  const each = [whole, ...counts.groups.map((group) => nisOf(rule, counts, [group]))];
  return refused > rule.many * all || each.some((nis) => above(rule, nis)) ? overconfident : consistent;
}

/** @typedef {{mean: number, low: number, high: number}} Nis */

/** Mean NIS of groups of components and its bounds: see insenv/evaluation/nis.py.
 * @param {Rule} rule
 * @param {Counts} counts
 * @param {Counts["groups"]} groups
 * @returns {Nis} */
function nisOf(rule, counts, groups) {
  const square = (/** @type {number} */ record) => groups.reduce((sum, { used }) => sum + used(record), 0);
  const number = (/** @type {number} */ record) => groups.reduce((sum, { usedNumber }) => sum + usedNumber(record), 0);
  const total = number(counts.records - 1);
  if (!total) return { mean: NaN, low: NaN, high: NaN };
  const mean = square(counts.records - 1) / total;
  const edges = edgesOf(rule, counts);
  let dependence = 1;
  if (edges.length > 1 && mean > 0) {
    const apart = edges.map((edge, k) => {
      const before = edges[k - 1];
      const [squares, numbers] = k ? [square(edge) - square(before), number(edge) - number(before)] : [square(edge), number(edge)];
      return { numbers, off: (squares - mean * numbers) ** 2 };
    });
    const white = (2 * mean ** 2 * apart.reduce((sum, one) => sum + one.numbers, 0)) / edges.length;
    dependence = Math.max(1, apart.reduce((sum, one) => sum + one.off, 0) / (edges.length - 1) / white);
  }
  const degrees = total / dependence;
  const [low, high] = rule.probabilities.map((probability) => chiSquareQuantile(probability, degrees) / degrees);
  return { mean, low, high };
}

/** Records that end the blocks; one block for few measurements.
 * @param {Rule} rule
 * @param {Counts} counts */
function edgesOf({ blocks }, counts) {
  const last = counts.count(counts.records - 1);
  if (last < 2 * blocks) return [counts.records - 1];
  const all = Array.from({ length: blocks }, (_, k) => firstWith(counts, (k + 1) * (last / blocks)));
  return [...new Set(all)];
}

/** The first record with at least this count.
 * @param {Counts} counts
 * @param {number} count */
function firstWith(counts, count) {
  let [low, high] = [0, counts.records - 1];
  while (low < high) {
    const middle = (low + high) >> 1;
    if (counts.count(middle) >= count) high = middle;
    else low = middle + 1;
  }
  return low;
}

/** @param {Rule} rule
 * @param {Nis} nis */
function above(rule, { mean, high }) {
  return mean > Math.max(high, rule.notable ** 2);
}

/** @param {Nis} nis */
function nisText({ mean, low, high }) {
  return mean >= 0 ? `NIS ${figure(mean)} (${significant(low, 3)} to ${significant(high, 3)})` : "none used";
}

/** What the verdict "consistent" means where the mean is outside the bounds; empty inside.
 * @param {Rule} rule
 * @param {Nis} nis */
function qualified({ notable }, { mean, low, high }) {
  if (mean < low) return ", innovations smaller than stated";
  return mean > high ? ` within ${(100 * (notable - 1)).toFixed(0)} % of sigma` : "";
}

/** @param {Rule} rule
 * @param {string} verdict
 * @param {number} factor */
function called(rule, verdict, factor) {
  return verdict === rule.verdicts[0] ? verdict : `${verdict}, factor ${figure(factor)}`;
}

/** Three digits, and no exponent of a large value.
 * @param {number} value */
function figure(value) {
  return value < 1000 ? significant(value, 3) : value.toFixed(0);
}

/** @param {number} part
 * @param {number} whole */
function percent(part, whole) {
  const share = (100 * part) / whole;
  return share < 99.5 ? significant(share, 2) : "100";
}
