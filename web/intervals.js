/** Values with their intervals beside a line at 1, on a logarithmic scale: factors, and ratios of after to before. */

import { h, panelOf } from "./dom.js";
import { number } from "./numbers.js";
import { scrolled, withUnit } from "./tables.js";

/** @typedef {{name: string, value: number | null, low: number | null, high: number | null}} Interval */

/** @param {{title: string, rows: Interval[]}} panel */
export function intervalsPanel({ title, rows }) {
  const known = (/** @type {number | null} */ value) => value !== null && Number.isFinite(value) && value > 0;
  const all = rows.flatMap(({ value, low, high }) => [value, low, high]).filter(known);
  const reach = Math.max(Math.log(1.1), ...all.map((value) => Math.abs(Math.log(Number(value)))));
  const share = (/** @type {number | null} */ value) => `${50 + (46 * Math.log(Number(value))) / reach}%`;
  const drawn = rows.map(({ name, value, low, high }) => {
    const line = h("div", { class: "line", "aria-hidden": "true" });
    const add = (/** @type {string} */ kind, /** @type {number} */ from, /** @type {number} */ to) => {
      const part = h("i", { class: kind });
      part.style.left = share(Math.min(from, to));
      part.style.width = `calc(${share(Math.max(from, to))} - ${share(Math.min(from, to))})`;
      line.append(part);
    };
    if (known(low) && known(high)) add("reach", Number(low), Number(high));
    else if (known(value) && low === null) add("reach", 1, Number(value));
    if (known(value)) add("dot", Number(value), Number(value));
    const ends = low === null && high === null ? null : h("span", {}, `(${number(low)} to ${number(high)})`);
    const [text, unit] = withUnit(name);
    const parts = String(text).split(/(?<=_)/).flatMap((part) => [part, h("wbr")]); // a long key of a parameter may be broken there
    const figure = h("td", { class: "figure" }, number(value), " ", ends);
    return h("tr", {}, h("th", { scope: "row" }, parts, unit), h("td", { class: "drawn" }, line), figure);
  });
  const element = panelOf("intervals", title, "", null, scrolled(title, h("tbody", {}, drawn)));
  return { element, show: () => {} };
}
