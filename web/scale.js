/** The vertical scale of a panel over time: linear, logarithmic, or logarithmic beyond a threshold, for the part shown. */

import { roundDown, ticks } from "./numbers.js";

/** Powers of ten that the linear part of a logarithmic scale takes at each side of 0, as in figures (insenv/report/figures.py):
 * a `linscale` of 1.3 there. */
const LINEAR = 1.3 / (1 - 1 / 10);

/** A scale that is linear up to a threshold, logarithmic beyond it: to places, and back to values.
 * @param {number} threshold */
export function symlog(threshold) {
  return {
    fwd: (/** @type {number} */ value) => {
      const size = Math.abs(value) / threshold;
      return Math.sign(value) * (size <= 1 ? LINEAR * size : LINEAR + Math.log10(size));
    },
    bwd: (/** @type {number} */ place) => {
      const size = Math.abs(place);
      return Math.sign(place) * threshold * (size <= LINEAR ? size / LINEAR : 10 ** (size - LINEAR));
    },
  };
}

/**
 * The range of the values shown.
 * @param {{y: (number | null)[], kind: string}[]} shown  curves: "line", "points" and "crosses" count fully, "limit" (plus and
 *   minus its values) by its last quarter, "band" by its middle value
 * @param {number} first  first place shown
 * @param {number} last  last place shown
 * @param {boolean} log
 * @param {number | null} level  a value that a logarithmic scale shows
 * @returns {[number, number]}
 */
export function rangeOf(shown, first, last, log, level) {
  let [low, high] = [Infinity, -Infinity];
  const take = (/** @type {number} */ value) => {
    if (value < low) low = value;
    if (value > high) high = value;
  };
  for (const { y, kind } of shown) {
    if (kind === "limit") {
      for (let place = Math.max(first, last - Math.floor((last - first) / 4)); place <= last; place++) {
        const value = y[place] ?? null; // a longer run may lie beside it
        if (value !== null) [value, -value].forEach(take);
      }
    } else if (kind === "band") {
      const some = y
        .slice(first, last + 1)
        .filter((value) => value !== null)
        .sort((a, b) => Number(a) - Number(b));
      if (some.length) take(Number(some[Math.floor(some.length / 2)]));
    } else {
      for (let place = first; place <= last; place++) if ((y[place] ?? null) !== null) take(Number(y[place]));
    }
  }
  if (low > high) return log ? [0.1, 10] : [-1, 1];
  if (log && level === null) return [low / 1.4, high * 1.4];
  if (log) return [Math.min(0.5 * Number(level), low / 1.4), Math.max(5 * Number(level), high * 1.5)];
  const room = high > low ? 0.08 * (high - low) : Math.max(1e-12, 0.05 * Math.abs(high));
  return [low - room, high + room];
}

/**
 * Values of the marks of an axis.
 * @param {number} low
 * @param {number} high
 * @param {number | null} threshold  up to which the scale is linear; null: it is linear throughout
 * @param {boolean} log
 * @param {number} count  about so many
 * @returns {number[]}
 */
export function marks(low, high, threshold, log, count) {
  if (log) return logMarks(low, high);
  const largest = Math.max(Math.abs(low), Math.abs(high));
  if (threshold === null || largest <= 2.5 * threshold) return ticks(low, high, count);
  const powers = [];
  for (let power = Math.ceil(Math.log10(3 * threshold)); 10 ** power <= largest; power++) powers.push(10 ** power);
  const stride = Math.max(1, Math.ceil(powers.length / 3));
  const beyond = powers.filter((_, place) => (powers.length - 1 - place) % stride === 0);
  const up = [threshold, ...(beyond.length ? beyond : [roundDown(largest / 1.2)].filter((value) => value > 1.5 * threshold))];
  return [...up.map((value) => -value).reverse(), 0, ...up].filter((value) => value >= low && value <= high);
}

/** @param {number} low
 * @param {number} high
 * @returns {number[]} */
function logMarks(low, high) {
  const found = [];
  const leads = high > 100 * low ? [1] : [1, 2, 5];
  for (let power = Math.floor(Math.log10(low)); 10 ** power <= high; power++) {
    for (const lead of leads) {
      const value = Number((lead * 10 ** power).toPrecision(3));
      if (value >= low && value <= high) found.push(value);
    }
  }
  return found;
}
