/** The text of a scenario file. */

/** Values with some changed by dotted key.
 * @param {object} values
 * @param {Record<string, any>} setting
 * @returns {object} */
export function withSetting(values, setting) {
  const copy = structuredClone(values);
  for (const [key, value] of Object.entries(setting)) {
    const path = key.split(".");
    const last = /** @type {string} */ (path.pop());
    /** @type {any} */
    let here = copy;
    for (const part of path) here = here[part] ??= {};
    here[last] = value;
  }
  return copy;
}

/** Values by key as TOML.
 * @param {object} values
 * @returns {string} */
export function tomlOf(values) {
  /** @type {string[]} */
  const lines = [];
  const isTable = (/** @type {any} */ value) => typeof value === "object" && value !== null && !Array.isArray(value);
  const write = (/** @type {object} */ table, /** @type {string[]} */ path) => {
    for (const [key, value] of Object.entries(table)) {
      if (!isTable(value) && value !== null) lines.push(`${keyOf(key)} = ${textOf(value)}`);
    }
    for (const [key, value] of Object.entries(table)) {
      if (!isTable(value)) continue;
      const name = [...path, keyOf(key)];
      lines.push("", `[${name.join(".")}]`);
      write(value, name);
    }
  };
  write(values, []);
  return `${lines.join("\n")}\n`;
}

/** @param {string} key */
function keyOf(key) {
  return /^[\w-]+$/.test(key) ? key : JSON.stringify(key);
}

/** @param {any} value
 * @returns {string} */
function textOf(value) {
  if (Array.isArray(value)) return `[${value.map(textOf).join(", ")}]`;
  if (typeof value === "object") {
    const pairs = Object.entries(value).filter(([, one]) => one !== null);
    return `{ ${pairs.map(([key, one]) => `${keyOf(key)} = ${textOf(one)}`).join(", ")} }`;
  }
  if (typeof value === "number") return Object.is(value, -0) ? "-0.0" : String(value);
  return JSON.stringify(value); // texts, true, false: as in JSON
}
