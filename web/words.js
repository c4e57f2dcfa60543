/** Sentences about what is not allowed: the thing, its value, and what is allowed; and sentences of the document, filled in. */

/** A sentence with values for the names in braces.
 * @param {string} sentence
 * @param {Record<string, string | number>} values
 * @returns {string} */
export function filled(sentence, values) {
  return sentence.replace(/\{(\w+)\}/g, (whole, name) => String(values[name] ?? whole));
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
