/** Health of a filter from its records: the rule of insenv/evaluation/nis.py and health.py, with the figures and sentences of the
 * document. tests/web/test_judging.py compares both. */

import { significant } from "./numbers.js";
import { filled } from "./words.js";

/**
 * @typedef {object} Rule  the figures of insenv/evaluation/nis.py
 * @property {number[][]} bounds  the lower and the upper: see `bound`
 * @property {number} blocks
 * @property {number} notable
 * @property {number} many
 * @property {number} most
 * @property {number} apart
 * @property {number} last
 * @property {number} fewest
 * @property {string[]} verdicts  from nothing known, and from good, to bad
 * @property {string[]} wrong  those of a filter whose innovations are larger than it states
 * @property {Record<string, string>} sentences
 *
 * @typedef {(record: number) => number} Column
 * @typedef {object} Counts  what a filter reports of one instrument: sums over all measurements so far, at each record
 * @property {number} records
 * @property {Column} count
 * @property {Column} refused
 * @property {{used: Column, usedNumber: Column, left: Column, leftNumber: Column}[]} groups
 *
 * @typedef {object} Judged  of one instrument
 * @property {string} id  of an aid; empty for the fixes of GNSS
 * @property {string} verdict
 * @property {number} factor
 * @property {number} refused
 * @property {number} count
 * @property {string} summary
 * @property {Nis[]} groups
 * @typedef {object} Health
 * @property {string} verdict
 * @property {string[]} lines
 * @property {Judged | null} own  by the fixes of GNSS; null if there was none
 * @property {Judged[]} others  by the aids that measured
 */

/** The health by the fixes of GNSS (null: it takes none) and by other aids; null if nothing was measured.
 * @param {Rule} rule
 * @param {Counts | null} fixes
 * @param {Record<string, Counts>} aids  by id
 * @returns {Health | null} */
export function healthOf(rule, fixes, aids) {
  const own = fixes && judged(rule, "", fixes, "fixes");
  const others = Object.entries(aids).flatMap(([id, counts]) => judged(rule, id, counts, "measurements") ?? []);
  const all = own ? [own, ...others] : others;
  if (!all.length) return null;
  const verdict = rule.verdicts[Math.max(...all.map((one) => rule.verdicts.indexOf(one.verdict)))];
  const whole = called(rule, verdict, Math.max(1, ...all.map((one) => one.factor)));
  const parted = own && verdict !== own.verdict;
  const first = parted ? filled(rule.sentences.whole_and_gnss, { called: whole, own: own.summary }) : (own?.summary ?? whole);
  return { verdict, lines: [first, ...others.map((one) => `${one.id}: ${one.summary}`)], own, others };
}

/** Sentences for the reader; none for a filter whose innovations are as stated.
 * @param {Rule} rule
 * @param {Health} health
 * @param {boolean} slow  whether the filter models slow errors of the fixes, which then cause no sentence
 * @param {Record<string, string>} causes  by id of an aid, what to look at where its measurements do not fit
 * @returns {string[]} */
export function healthNotes({ sentences, verdicts, wrong: faults, notable }, { own, others }, slow, causes) {
  const diverged = verdicts[verdicts.length - 1];
  const wrong = others.filter((one) => faults.includes(one.verdict));
  wrong.sort((one, other) => other.factor - one.factor || (one.id < other.id ? 1 : -1));
  const ofAids = wrong.map((one) => {
    const look = one.id in causes ? filled(sentences.causes, { causes: causes[one.id] }) : "";
    return filled(sentences.aid, { ...one, factor: figure(one.factor) }) + look;
  });
  if (!own) return ofAids;
  if (faults.includes(own.verdict)) {
    const aids = others.map((one) => one.id).join(", ");
    const told = own.verdict === diverged ? sentences.fixes_diverged : sentences.fixes_overconfident;
    const values = { ...own, factor: figure(own.factor), or_aids: aids && filled(sentences.or_aids, { aids }) };
    return [filled(told, values), ...ofAids];
  }
  const { mean, low } = own.groups[0];
  const small = mean < Math.min(low, notable ** -2);
  return small && !slow ? [filled(sentences.slow, { mean: significant(mean, 2) }), ...ofAids] : ofAids;
}

/** Null if nothing was measured.
 * @param {Rule} rule
 * @param {string} id
 * @param {Counts} counts
 * @param {string} what
 * @returns {Judged | null} */
function judged(rule, id, counts, what) {
  const end = counts.records - 1;
  const count = counts.records ? counts.count(end) : 0;
  if (!count) return null;
  const whole = nisOf(rule, counts, counts.groups);
  const groups = counts.groups.map((group) => nisOf(rule, counts, [group]));
  const verdict = verdictOf(rule, counts, [whole, ...groups]);
  const ratios = counts.groups.map(
    ({ used, usedNumber, left, leftNumber }) =>
      (used(end) + left(end)) / Math.max(1, usedNumber(end) + leftNumber(end)),
  );
  const [untested, consistent] = rule.verdicts;
  const factor = rule.wrong.includes(verdict) ? Math.sqrt(Math.max(...ratios)) : 1;
  const refused = counts.refused(end);
  const summary = filled(verdict === untested ? rule.sentences.untested : rule.sentences.summary, {
    called: called(rule, verdict, factor) + (verdict === consistent ? qualified(rule, whole) : ""),
    share: percent(refused, count),
    count,
    what,
    nis: nisText(rule, whole),
  });
  return { id, verdict, factor, refused, count, summary, groups };
}

/** @param {Rule} rule
 * @param {Counts} counts
 * @param {Nis[]} each  of all components, and of each group */
function verdictOf(rule, counts, each) {
  const [untested, consistent, overconfident, diverged] = rule.verdicts;
  const end = counts.records - 1;
  if (!counts.groups.some(({ usedNumber, leftNumber }) => usedNumber(end) + leftNumber(end))) return untested;
  const [all, refused] = [counts.count(end), counts.refused(end)];
  const late = firstWith(counts, rule.last * all);
  const since = (/** @type {Column} */ column) => column(end) - column(late);
  if (refused > rule.most * all) return diverged;
  const apart = counts.groups.some(({ used, usedNumber }) => since(used) > rule.apart ** 2 * since(usedNumber));
  if (since(counts.count) >= rule.fewest && (since(counts.refused) > rule.most * since(counts.count) || apart)) return diverged;
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
  const [low, high] = rule.bounds.map((coefficients) => bound(coefficients, degrees));
  return { mean, low, high };
}

/** A quantile of chi-square over its degrees of freedom (`bound_polynomial` of insenv/evaluation/chi_square.py).
 * @param {number[]} coefficients  of powers of 1 / sqrt(degrees)
 * @param {number} degrees
 * @returns {number} */
export function bound(coefficients, degrees) {
  return coefficients.reduceRight((sum, one) => sum / Math.sqrt(degrees) + one, 0) ** 3;
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

/** @param {Rule} rule
 * @param {Nis} nis */
function nisText({ sentences }, { mean, low, high }) {
  if (!(mean >= 0)) return sentences.none_used;
  return filled(sentences.nis, { mean: figure(mean), low: significant(low, 3), high: significant(high, 3) });
}

/** What the verdict "consistent" means where the mean is outside the bounds; empty inside.
 * @param {Rule} rule
 * @param {Nis} nis */
function qualified({ notable, sentences }, { mean, low, high }) {
  if (mean < low) return sentences.smaller;
  return mean > high ? filled(sentences.within, { percent: (100 * (notable - 1)).toFixed(0) }) : "";
}

/** @param {Rule} rule
 * @param {string} verdict
 * @param {number} factor */
function called({ sentences, wrong }, verdict, factor) {
  return wrong.includes(verdict) ? filled(sentences.called, { verdict, factor: figure(factor) }) : verdict;
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
