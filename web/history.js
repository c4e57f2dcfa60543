/** What the simulation has shown: its records, one row of outputs each, and the columns that plots draw. */

/**
 * @typedef {object} Recorded
 * @property {(name: string) => any} at  the row of an output
 * @property {() => number} count
 * @property {(rows: Float64Array) => void} add  rows of outputs, one after the other
 * @property {() => Recorded} retire  begin again; gives what there was
 * @property {(column: number, place: number) => number} value  of an output at a record
 * @property {(place: number) => Float64Array} row  the outputs at a record
 * @property {(count: number) => Recorded} first  only so many of the records
 */

/** @param {(name: string) => any} at
 * @param {number} width  outputs
 * @param {number} most  records
 * @returns {Recorded} */
export function makeHistory(at, width, most) {
  return recorded(at, new Float64Array(width * most), width, 0);
}

/** @param {(name: string) => any} at
 * @param {Float64Array} kept
 * @param {number} width
 * @param {number} count
 * @returns {Recorded} */
function recorded(at, kept, width, count) {
  return {
    at,
    count: () => count,
    add: (rows) => {
      const some = Math.min(rows.length, kept.length - count * width) / width;
      kept.set(rows.subarray(0, some * width), count * width);
      count += some;
    },
    retire: () => {
      const before = recorded(at, kept, width, count);
      [kept, count] = [new Float64Array(kept.length), 0];
      return before;
    },
    value: (column, place) => kept[place * width + column],
    row: (place) => kept.subarray(place * width, (place + 1) * width),
    first: (some) => recorded(at, kept, width, some),
  };
}

/** The first of so many places from which on something holds; their number if it never does.
 * @param {number} places
 * @param {(place: number) => boolean} holds */
export function firstWhere(places, holds) {
  let [low, high] = [0, places];
  while (low < high) {
    const middle = (low + high) >> 1;
    if (holds(middle)) high = middle;
    else low = middle + 1;
  }
  return low;
}

/** Values at times between given ones, by straight lines; constant outside.
 * @param {number[]} times
 * @param {number[]} values
 * @param {number} time */
export function between(times, values, time) {
  const last = times.length - 1;
  if (time <= times[0]) return values[0];
  if (time >= times[last]) return values[last];
  const high = firstWhere(last, (place) => times[place] > time);
  const low = high - 1;
  const share = (time - times[low]) / (times[high] - times[low]);
  return values[low] + share * (values[high] - values[low]);
}
