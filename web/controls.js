/** Controls of a scenario's keys: names, units, bounds and meanings are those of the document. */

import { checked } from "./address.js";
import { button, h } from "./dom.js";
import { roundDown } from "./numbers.js";
import { given, rangesOf, stillUsed } from "./words.js";

const GROUPS = { imu: "Inertial unit", gnss: "GNSS", knowledge: "What estimators assume", vehicle: "Vehicle", start: "Start" };

/**
 * @param {any} live  the document
 * @param {(seed: number | null, values: Record<string, any>) => void} change  what differs now: the seed (null: as it is) and values
 *   by key; undefined for the scenario's own
 * @param {() => void} restore  the scenario as it was
 * @param {() => void} close  what the drawer of the controls asks for
 */
export function controlPanel(live, change, restore, close) {
  /** @type {Map<string, (value: any) => void>} */
  const shown = new Map();
  const seed = seedRow(live, (value) => change(value, {}));
  const known = [...new Set([...Object.keys(GROUPS), ...live.controls.map((/** @type {any} */ one) => one.group)])];
  const groups = known
    .map((group) => ({ group, controls: live.controls.filter((/** @type {any} */ control) => control.group === group) }))
    .filter(({ controls }) => controls.length)
    .map(({ group, controls }, place) => {
      const rows = controls.map((/** @type {any} */ control) => {
        const take = (/** @type {any} */ value) => change(null, { [control.key]: value });
        const row = control.options ? choice(control, take) : amount(control, take);
        shown.set(control.key, row.show);
        return row.element;
      });
      const name = GROUPS[/** @type {keyof typeof GROUPS} */ (group)] ?? group;
      return h("details", { open: place === 0 }, h("summary", {}, name), h("div", { class: "rows" }, rows));
    });
  const element = h(
    "section",
    { class: "controls", id: "settings", "aria-label": "Settings", hidden: true },
    h("div", { class: "head" }, h("h2", {}, "Settings"), button("Close", close, { class: "quiet" })),
    h("p", { class: "quiet" }, "A change starts the run again."),
    seed.element,
    groups,
    button("Restore the scenario", restore, { class: "quiet", id: "restore" }),
  );
  return {
    element,
    /** Show what is in force.
     * @param {number} number  the seed
     * @param {Record<string, any>} values */
    show: (number, values) => {
      seed.show(number);
      // one of several sets of numbers brings its own figures: those of its section that are not given are then not known here
      const sections = live.controls
        .filter((/** @type {any} */ one) => one.options && one.key in values)
        .map((/** @type {any} */ one) => section(one.key));
      for (const control of live.controls) {
        const own = sections.includes(section(control.key)) && !control.options ? null : control.value;
        shown.get(control.key)?.(control.key in values ? values[control.key] : own);
      }
    },
  };
}

/** The section of a scenario that a key is in.
 * @param {string} key */
function section(key) {
  return key.split(".")[0];
}

/** @param {any} live
 * @param {(value: number) => void} take */
function seedRow(live, take) {
  const ranges = live.seeds.numbers;
  const read = (/** @type {string} */ text) => {
    const value = Number(text);
    const whole = Number.isInteger(value);
    const within = (/** @type {number[]} */ [first, last]) => value >= first && value <= last;
    if (text.trim() !== "" && whole && ranges.some(within)) return value;
    throw new Error(`${given("seed", text)}: allowed is ${whole ? "" : "a whole number, "}${rangesOf(ranges)}`);
  };
  const bounds = { type: "number", min: ranges[0][0], max: ranges.at(-1)[1], step: 1 };
  const { input, wrong, give, show } = field("seed", { ...bounds, "aria-describedby": "seed-wrong" }, read, String, take);
  const more = () => give(String(Number(input.value) + 1));
  const next = button("Next", more, { class: "quiet", title: "The next unit and weather" });
  return { element: rowOf("seed", "seed", null, h("div", { class: "pair" }, input, next), wrong), show };
}

/** A control below its label.
 * @param {string} id  of its field
 * @param {string} label
 * @param {string | null} title
 * @param {...any} parts */
function rowOf(id, label, title, ...parts) {
  return h("div", { class: "control" }, h("label", { for: id, title }, label), parts);
}

/** A field for a number, and the sentence on what is wrong with what it holds.
 * @param {string} id
 * @param {Record<string, any>} attributes
 * @param {(text: string) => number} read  throws an Error with one sentence for a value that is not allowed
 * @param {(value: number | null) => string} said  a value in that sentence
 * @param {(value: number) => void} take */
function field(id, attributes, read, said, take) {
  const input = h("input", { id, ...attributes });
  const wrong = h("p", { class: "wrong", role: "alert", id: `${id}-wrong` });
  let used = /** @type {number | null} */ (null);
  const give = (/** @type {string} */ text) => {
    input.value = text;
    try {
      const value = read(text);
      wrong.textContent = "";
      used = value;
      take(value);
    } catch (error) {
      wrong.textContent = `${error instanceof Error ? error.message : error}. ${stillUsed(said(used))}`;
    }
  };
  input.addEventListener("change", () => give(input.value));
  const show = (/** @type {number | null} */ value) => {
    used = value;
    input.value = value === null ? "" : String(value);
    wrong.textContent = "";
  };
  return { input, wrong, give, show };
}

/** One of several sets of numbers.
 * @param {any} control
 * @param {(value: any) => void} take */
function choice(control, take) {
  const id = `control-${control.key}`;
  const options = control.options.map((/** @type {any} */ option) => h("option", { value: option.value }, option.label));
  const select = h("select", { id, title: control.meaning, onchange: () => take(select.value) }, options);
  return { element: rowOf(id, control.label, control.meaning, select), show: (/** @type {any} */ value) => (select.value = value ?? "") };
}

/** A number with its unit, and a slider over its usual range.
 * @param {any} control
 * @param {(value: any) => void} take */
function amount(control, take) {
  const { key, label, unit, meaning, low, high, minimum, maximum } = control;
  const id = `control-${key}`;
  const of = unit ? ` ${unit}` : "";
  const bounds = `${meaning}; ${minimum} to ${maximum}${of}`;
  const attributes = {
    type: "text",
    inputmode: "decimal",
    autocomplete: "off",
    placeholder: "drawn",
    "aria-describedby": `${id}-bounds`,
    title: bounds,
  };
  const said = (/** @type {number | null} */ value) => (value === null ? `the value ${input.placeholder}` : `${value}${of}`);
  const { input, wrong, give, show } = field(id, attributes, (text) => checked(control, text), said, take);
  const slider = h("input", {
    type: "range",
    min: low,
    max: high,
    step: "any",
    "aria-label": `${label}, slider`,
    title: bounds,
  });
  const step = roundDown(Math.max((high - low) / 400, 1e-12));
  const rounded = () => String(Number((Math.round(Number(slider.value) / step) * step).toPrecision(10)));
  slider.addEventListener("input", () => (input.value = rounded()));
  slider.addEventListener("change", () => give(rounded()));
  const pair = h("div", { class: "pair" }, input, h("span", { class: "unit" }, unit));
  const element = rowOf(id, label, meaning, pair, slider, h("span", { class: "hidden", id: `${id}-bounds` }, bounds), wrong);
  return {
    element,
    show: (/** @type {any} */ value) => {
      show(value ?? null);
      input.placeholder = control.value === null ? "drawn" : "of the set";
      slider.value = String(value ?? (low + high) / 2);
    },
  };
}
