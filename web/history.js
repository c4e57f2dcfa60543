/** What the simulation has shown: its records, one row of outputs each, and the columns that plots draw. */

/**
 * @typedef {object} Recorded
 * @property {() => number} count
 * @property {(rows: Float64Array) => void} add  rows of outputs, one after the other
 * @property {() => Recorded} retire  begin again; gives what there was
 * @property {(at: number, place: number) => number} value  of an output at a record
 * @property {(place: number) => Float64Array} row  the outputs at a record
 * @property {(count: number) => Recorded} first  only so many of the records
 */

/** @param {number} width  outputs
 * @param {number} most  records
 * @returns {Recorded} */
export function makeHistory(width, most) {
  return recorded(new Float64Array(width * most), width, 0);
}

/** @param {Float64Array} kept
 * @param {number} width
 * @param {number} count
 * @returns {Recorded} */
function recorded(kept, width, count) {
  return {
    count: () => count,
    add: (rows) => {
      const some = Math.min(rows.length, kept.length - count * width) / width;
      kept.set(rows.subarray(0, some * width), count * width);
      count += some;
    },
    retire: () => {
      const before = recorded(kept, width, count);
      [kept, count] = [new Float64Array(kept.length), 0];
      return before;
    },
    value: (at, place) => kept[place * width + at],
    row: (place) => kept.subarray(place * width, (place + 1) * width),
    first: (some) => recorded(kept, width, some),
  };
}

/** Values at times between given ones, by straight lines; constant outside.
 * @param {number[]} times
 * @param {number[]} values
 * @param {number} time */
export function between(times, values, time) {
  let [low, high] = [0, times.length - 1];
  if (time <= times[0]) return values[0];
  if (time >= times[high]) return values[high];
  while (high - low > 1) {
    const middle = (low + high) >> 1;
    if (times[middle] <= time) low = middle;
    else high = middle;
  }
  const share = (time - times[low]) / (times[high] - times[low]);
  return values[low] + share * (values[high] - values[low]);
}
