/** Health of a filter from its records: the rule of insenv/evaluation/nis.py, compiled, and what it shows as text. */

import { bytesOf } from "./arrays.js";
import { significant } from "./numbers.js";
import { filled } from "./words.js";

/**
 * @typedef {object} Rule  insenv/web/judging.py
 * @property {string | null} wasm  `equation` of insenv/evaluation/nis.py for so many `groups`
 * @property {number} groups
 * @property {number} blocks
 * @property {number} last
 * @property {number} notable
 * @property {string[]} verdicts  from nothing known, and from good, to bad
 * @property {string[]} wrong  those of a filter whose innovations are larger than it states
 * @property {Record<string, string>} sentences
 *
 * @typedef {(record: number) => number} Column
 * @typedef {object} Sums  what a filter reports of one instrument: `Sums` of insenv/evaluation/nis.py
 * @property {number} records
 * @property {Column[]} columns  count, refused, and of each group used, their number, left, their number
 *
 * @typedef {{mean: number, low: number, high: number}} Nis
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

/** @type {any} */
let compiled = null;

/** Make the rule ready; nothing is judged before.
 * @param {Rule} rule */
export async function loadRule({ wasm }) {
  if (wasm) useRule(/** @type {any} */ (await WebAssembly.instantiate(bytesOf(wasm))).instance);
}

/** @param {WebAssembly.Instance} instance */
export function useRule(instance) {
  compiled = instance.exports;
  compiled.memory.grow(1);
}

/** The numbers that the rule gives: verdict, factor, then mean, low and high of all components and of each group.
 * @param {Rule} rule
 * @param {Sums} sums
 * @returns {Float64Array} */
function numbersOf({ groups, blocks, last }, sums) {
  const end = sums.records - 1;
  const [count] = sums.columns;
  const ends = Array.from({ length: blocks }, (_, k) => (count(end) < 2 * blocks ? end : firstWith(sums, ((k + 1) * count(end)) / blocks)));
  const width = sums.columns.length;
  const from = (compiled.__heap_base.value + 15) & ~15;
  const late = from + 8 * blocks * width;
  const found = late + 8 * width;
  const records = [...ends, firstWith(sums, last * count(end))];
  new Float64Array(compiled.memory.buffer, from, (blocks + 1) * width).set(records.flatMap((record) => sums.columns.map((one) => one(record))));
  compiled.judge(from, late, found);
  return new Float64Array(compiled.memory.buffer, found, 2 + 3 * (groups + 1)).slice();
}

/** The first record with at least this count.
 * @param {Sums} sums
 * @param {number} count */
function firstWith({ records, columns }, count) {
  let [low, high] = [0, records - 1];
  while (low < high) {
    const middle = (low + high) >> 1;
    if (columns[0](middle) >= count) high = middle;
    else low = middle + 1;
  }
  return low;
}

/** The health by the fixes of GNSS (null: it takes none) and by other aids; null if nothing was measured.
 * @param {Rule} rule
 * @param {Sums | null} fixes
 * @param {Record<string, Sums>} aids  by id
 * @returns {Health | null} */
export function healthOf(rule, fixes, aids) {
  const own = fixes && judged(rule, "", fixes, "fixes");
  const others = Object.entries(aids).flatMap(([id, sums]) => judged(rule, id, sums, "measurements") ?? []);
  const all = own ? [own, ...others] : others;
  if (!all.length) return null;
  const verdict = rule.verdicts[Math.max(...all.map((one) => rule.verdicts.indexOf(one.verdict)))];
  const whole = called(rule, verdict, Math.max(1, ...all.map((one) => one.factor)));
  const parted = own && verdict !== own.verdict;
  const first = parted ? filled(rule.sentences["whole-and-gnss"], { called: whole, of_gnss: own.summary }) : (own?.summary ?? whole);
  return { verdict, lines: [first, ...others.map((one) => `${one.id}: ${one.summary}`)], own, others };
}

/** Sentences for the reader; none for a filter whose innovations are as stated.
 * @param {Rule} rule
 * @param {Health} health
 * @param {boolean} slow  whether the filter models slow errors of the fixes, which then cause no sentence
 * @param {Record<string, string>} causes  by id of an aid, what to look at where its measurements do not fit
 * @returns {string[]} */
export function healthNotes({ sentences, wrong: faults, notable }, { own, others }, slow, causes) {
  const wrong = others.filter((one) => faults.includes(one.verdict));
  wrong.sort((one, other) => other.factor - one.factor || (one.id < other.id ? 1 : -1));
  const ofAids = wrong.map((one) => {
    const look = one.id in causes ? filled(sentences.causes, { causes: causes[one.id] }) : "";
    return filled(sentences["aid-misfit"], { ...one, factor: figure(one.factor), look });
  });
  if (!own) return ofAids;
  if (faults.includes(own.verdict)) {
    const aids = others.map((one) => one.id).join(", ");
    const values = { ...own, factor: figure(own.factor), or_aids: aids && filled(sentences["or-aids"], { aids }) };
    return [filled(sentences[`fixes-${own.verdict}`], values), ...ofAids];
  }
  const { mean, low } = own.groups[0];
  const small = mean < Math.min(low, notable ** -2);
  return small && !slow ? [filled(sentences["fixes-slow-errors"], { mean }), ...ofAids] : ofAids;
}

/** Null if nothing was measured.
 * @param {Rule} rule
 * @param {string} id
 * @param {Sums} sums
 * @param {string} what
 * @returns {Judged | null} */
function judged(rule, id, sums, what) {
  const { sentences } = rule;
  const [count, refused] = sums.records ? sums.columns.slice(0, 2).map((column) => column(sums.records - 1)) : [0, 0];
  if (!count) return null;
  const [place, rms, ...numbers] = numbersOf(rule, sums);
  const verdict = rule.verdicts[place];
  const factor = rule.wrong.includes(verdict) ? rms : 1;
  const [whole, ...groups] = Array.from({ length: numbers.length / 3 }, (_, k) => {
    const [mean, low, high] = numbers.slice(3 * k, 3 * k + 3);
    return { mean, low, high };
  });
  const outside = whole.mean < whole.low ? sentences.smaller : whole.mean > whole.high ? sentences.within : "";
  const share = (100 * refused) / count;
  const summary = filled(verdict === rule.verdicts[0] ? sentences.untested : sentences.summary, {
    called: called(rule, verdict, factor) + (verdict === rule.verdicts[1] ? outside : ""),
    share: share < 99.5 ? significant(share, 2) : "100",
    count,
    what,
    nis: whole.mean >= 0 ? filled(sentences.nis, { ...whole, mean: figure(whole.mean) }) : sentences["none-used"],
  });
  return { id, verdict, factor, refused, count, summary, groups };
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
