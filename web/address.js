/** The state of a live page in its address: a link repeats the run. Commands stand there deflated, each with what it changes. */

import { bytesOf, piped, textOf } from "./arrays.js";
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
 * @returns {Promise<string>} */
export async function addressOf(state, seed) {
  const parts = new URLSearchParams();
  if (state.seed !== seed) parts.set("seed", String(state.seed));
  for (const [key, value] of Object.entries(state.values))
    parts.set(key, typeof value === "string" ? value : JSON.stringify(value));
  if (state.commands?.length) parts.set("commands", await packed(JSON.stringify(differences(state.commands))));
  return parts.toString();
}

/** Of each command the samples since the one before, and the values that it changes.
 * @param {import("./checks.js").Command[]} commands
 * @returns {[number, Record<string, number>][]} */
function differences(commands) {
  return commands.map(({ sample, values }, place) => {
    const before = commands[place - 1] ?? { sample: 0, values: {} };
    const other = Object.entries(values).filter(([name, value]) => before.values[name] !== value);
    return [sample - before.sample, Object.fromEntries(other)];
  });
}

/** Deflated, in the base64 of addresses.
 * @param {string} text
 * @returns {Promise<string>} */
async function packed(text) {
  const bytes = await piped(text, new CompressionStream("deflate-raw"));
  return textOf(bytes).replaceAll("+", "-").replaceAll("/", "_").replace(/=+$/, "");
}

/** @param {string} text  of `packed`
 * @returns {Promise<string>} */
async function unpacked(text) {
  const bytes = bytesOf(text.replaceAll("-", "+").replaceAll("_", "/").padEnd(4 * Math.ceil(text.length / 4), "="));
  return new TextDecoder().decode(await piped(bytes, new DecompressionStream("deflate-raw")));
}

/** The state that an address holds. Rejects with an Error with one sentence for what it cannot mean.
 * @param {string} fragment  with or without "#"
 * @param {any} live  the document
 * @returns {Promise<State>} */
export async function stateOf(fragment, live) {
  /** @type {State} */
  const state = { seed: live.seed, values: {}, commands: undefined };
  const parts = new URLSearchParams(fragment.replace(/^#/, ""));
  for (const [key, text] of parts) {
    if (parts.getAll(key).length > 1) throw new Error(`${key} stands in the link more than once: allowed is one value`);
    if (key === "seed") {
      if (!/^\d+$/.test(text)) throw new Error(`${given("seed", text)}: allowed is a whole number`);
      state.seed = Number(text);
    } else if (key === "commands") {
      state.commands = await commandsOf(text, live);
    } else {
      state.values[key] = valueOf(key, text, live);
    }
  }
  return state;
}

/** @param {string} text  as `addressOf` writes it, or the commands themselves as links once held them
 * @param {any} live
 * @returns {Promise<import("./checks.js").Command[]>} */
async function commandsOf(text, live) {
  const plain = text.startsWith("[");
  const found = parsed("commands", plain ? text : await unpacked(text).catch(() => text));
  const good =
    Array.isArray(found) &&
    found.every(
      (one) =>
        Array.isArray(one) && one.length === 2 && typeof one[1] === "object" && one[1] !== null && !Array.isArray(one[1]),
    );
  if (!good) throw new Error("commands: allowed are pairs of a sample and the values of commands");
  /** @type {import("./checks.js").Command[]} */
  const commands = [];
  for (const [sample, values] of found) {
    const before = commands.at(-1);
    commands.push(plain || !before ? { sample, values } : { sample: before.sample + sample, values: { ...before.values, ...values } });
  }
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
