/** Sentences about what is not allowed: the thing, its value, and what is allowed; and sentences of the document, filled in. */

import { significant } from "./numbers.js";

/** A text with values for the names in braces: the form and what it means are those of `filled` in insenv/base/remarks.py.
 * @param {string} text
 * @param {Record<string, any>} values  strings and numbers; others that no name in braces asks for may be among them
 * @returns {string} */
export function filled(text, values) {
  for (let before = ""; before !== text; ) {
    before = text;
    text = text.replace(/\{(\w+)\|((?:[^{}]|\{\w+(?::[^{}|]*)?\})*)\}/g, (whole, name, texts) =>
      name in values ? texts.split("|")[values[name]] : whole,
    );
  }
  return text.replace(/\{(\w+)(?::\.?(\d)(g| digits))?\}/g, (whole, name, digits, form) => {
    const value = values[name] ?? whole;
    if (!digits || typeof value !== "number") return String(value);
    return form === "g" || value < 10 ** digits - 0.5 ? significant(value, Number(digits)) : value.toFixed(0);
  });
}

/** The values, and by name these texts filled in, each with the values and the texts before it.
 * @param {Record<string, string>} texts
 * @param {Record<string, any>} values
 * @returns {Record<string, any>} */
export function worded(texts, values) {
  return Object.entries(texts).reduce((made, [name, text]) => ({ ...made, [name]: filled(text, made) }), values);
}

/** Texts one after the other, "or" before the last.
 * @param {string[]} texts
 * @returns {string} */
export function orOf(texts) {
  return texts.length < 2 ? texts.join("") : `${texts.slice(0, -1).join(", ")} or ${texts.at(-1)}`;
}

/** Whole numbers in ranges: "0 to 1023 or 5000".
 * @param {[number, number][]} ranges  first and last
 * @returns {string} */
export function rangesOf(ranges) {
  return orOf(ranges.map(([first, last]) => (first === last ? `${first}` : `${first} to ${last}`)));
}

/** What is wrong with a value given for a number.
 * @param {{key: string, unit?: string, minimum: number, maximum: number}} control
 * @param {unknown} value  a number, or the text that was typed
 * @returns {string} */
export function beyond({ key, unit, minimum, maximum }, value) {
  const of = unit && unit !== "1" ? ` ${unit}` : "";
  return `${given(key, value, of)}: allowed is ${minimum} to ${maximum}${of}`;
}

/** What is wrong with a name that is none of a list.
 * @param {string} key
 * @param {string} value
 * @param {string[]} names  allowed
 * @returns {string} */
export function oneOf(key, value, names) {
  return `${key} = ${JSON.stringify(value)}: allowed is ${orOf(names)}`;
}

/** What a field that shows a wrong value does not say: which value the run has.
 * @param {string} value */
export function stillUsed(value) {
  return `The run still uses ${value}.`;
}

/** What was given: "seed = 1.5", or "seed is empty".
 * @param {string} key
 * @param {unknown} value
 * @param {string} [unit]  with a space before it */
export function given(key, value, unit = "") {
  return String(value).trim() === "" ? `${key} is empty` : `${key} = ${value}${unit}`;
}
