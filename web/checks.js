/** What a link, a page and its worker allow: outages and commands. Each throws an Error with one sentence. */

import { beyond } from "./words.js";

/** @typedef {{sample: number, values: Record<string, number>}} Command  by name, SI, from a sample on */

/** @param {{key: string, most: number}} outage
 * @param {any} windows  [begin, end] each, s */
export function checkWindows({ key, most }, windows) {
  const good = (/** @type {any} */ one) =>
    Array.isArray(one) && one.length === 2 && one.every(Number.isFinite) && one[0] >= 0 && one[0] < one[1];
  if (!Array.isArray(windows) || !windows.every(good)) {
    const text = JSON.stringify(windows).slice(0, 40);
    throw new Error(`${key} = ${text} s: allowed are pairs of a begin of 0 s or later and an end after it`);
  }
  if (windows.length > most) throw new Error(`${key}: at most ${most} outages, ${windows.length} given`);
}

/** @param {any} live
 * @param {Command[]} commands */
export function checkCommands(live, commands) {
  let before = 0;
  for (const { sample, values } of commands) {
    if (!live.commands) throw new Error("the vehicle of this scenario takes no commands");
    if (!(Number.isInteger(sample) && sample >= before)) {
      throw new Error(`commands at sample ${sample}: allowed are whole numbers in order`);
    }
    before = sample;
    for (const [name, value] of Object.entries(values)) {
      const row = live.tables.inputs.find((/** @type {any} */ one) => one.name === `command_${name}`);
      if (!row) throw new Error(`commands: unknown command ${JSON.stringify(name)}`);
      const { unit, minimum = -Infinity, maximum = Infinity } = row;
      if (typeof value !== "number" || !(value >= minimum && value <= maximum)) {
        throw new Error(beyond({ key: `command ${name}`, unit, minimum, maximum }, JSON.stringify(value)));
      }
    }
  }
}
