/** The state of a live page in its address: a link repeats the run. */

import { checkCommands, checkWindows } from "./checks.js";
import { beyond, given } from "./words.js";

/**
 * @typedef {object} State
 * @property {number} seed
 * @property {Record<string, any>} values  of controls by key
 * @property {import("./checks.js").Command[] | undefined} commands
 */

/** The part of an address after "#" for a state.
 * @param {State} state
 * @param {number} seed  of the scenario, which needs no mention
 * @returns {string} */
export function addressOf(state, seed) {
  const parts = new URLSearchParams();
  if (state.seed !== seed) parts.set("seed", String(state.seed));
  for (const [key, value] of Object.entries(state.values))
    parts.set(key, typeof value === "string" ? value : JSON.stringify(value));
  if (state.commands?.length)
    parts.set("commands", JSON.stringify(state.commands.map(({ sample, values }) => [sample, values])));
  return parts.toString();
}

/** The state that an address holds. Throws an Error with one sentence for what it cannot mean.
 * @param {string} fragment  with or without "#"
 * @param {any} live  the document
 * @returns {State} */
export function stateOf(fragment, live) {
  /** @type {State} */
  const state = { seed: live.seed, values: {}, commands: undefined };
  const parts = new URLSearchParams(fragment.replace(/^#/, ""));
  for (const [key, text] of parts) {
    if (parts.getAll(key).length > 1) throw new Error(`${key} stands in the link more than once: allowed is one value`);
    if (key === "seed") {
      if (!/^\d+$/.test(text)) throw new Error(`${given("seed", text)}: allowed is a whole number`);
      state.seed = Number(text);
    } else if (key === "commands") {
      state.commands = commandsOf(text, live);
    } else {
      state.values[key] = valueOf(key, text, live);
    }
  }
  return state;
}

/** @param {string} text
 * @param {any} live
 * @returns {import("./checks.js").Command[]} */
function commandsOf(text, live) {
  const found = parsed("commands", text);
  const good =
    Array.isArray(found) &&
    found.every(
      (one) =>
        Array.isArray(one) && one.length === 2 && typeof one[1] === "object" && one[1] !== null && !Array.isArray(one[1]),
    );
  if (!good) throw new Error("commands: allowed are pairs of a sample and the values of commands");
  const commands = found.map(([sample, values]) => ({ sample, values }));
  checkCommands(live, commands);
  return commands;
}

/** @param {string} key
 * @param {string} text
 * @param {any} live */
function valueOf(key, text, live) {
  const outage = live.outages.find((/** @type {any} */ one) => one.key === key);
  if (outage) {
    const windows = parsed(key, text);
    checkWindows(outage, windows);
    return windows;
  }
  const control = live.controls.find((/** @type {any} */ one) => one.key === key);
  if (!control) throw new Error(`${key || '""'}: this page has no control of that name`);
  if (control.options) return text;
  return checked(control, text);
}

/** The number that a control is given as a text. Throws an Error that says what is allowed.
 * @param {{key: string, unit: string, minimum: number, maximum: number}} control
 * @param {string} text
 * @returns {number} */
export function checked(control, text) {
  const value = Number(text);
  if (text.trim() === "" || !(value >= control.minimum && value <= control.maximum)) throw new Error(beyond(control, text));
  return value;
}

/** @param {string} key
 * @param {string} text */
function parsed(key, text) {
  try {
    return JSON.parse(text);
  } catch {
    throw new Error(`${given(key, text.slice(0, 40))}: allowed is a list of values`);
  }
}
