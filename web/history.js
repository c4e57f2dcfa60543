/** What the simulation has shown: its records, one row of outputs each, and the columns that plots draw. */

/**
 * @typedef {object} Recorded
 * @property {() => number} count
 * @property {(rows: Float64Array) => void} add  rows of outputs, one after the other
 * @property {() => void} clear
 * @property {(at: number, place: number) => number} value  of an output at a record
 */

/** @param {number} width  outputs
 * @param {number} most  records
 * @returns {Recorded} */
export function makeHistory(width, most) {
  const kept = new Float64Array(width * most);
  let count = 0;
  return {
    count: () => count,
    add: (rows) => {
      const some = Math.min(rows.length / width, most - count);
      kept.set(rows.subarray(0, some * width), count * width);
      count += some;
    },
    clear: () => (count = 0),
    value: (at, place) => kept[place * width + at],
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
