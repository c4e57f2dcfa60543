/** Tables of figures: names and units at the left, aligned figures, the health of a filter as a word. */

import { h } from "./dom.js";
import { minus, plain } from "./numbers.js";
import { groupColour, swatch } from "./theme.js";

const HEALTH = "Health: ";

/** A text that may hold a unit in brackets, as "heading [deg]": the unit is shown beside it.
 * @param {string} text */
export function withUnit(text) {
  const found = /^(.*) \[(.*)\]$/.exec(text);
  return found ? [found[1], h("span", { class: "unit" }, ` ${found[2]}`)] : [text];
}

/** A table that scrolls sideways where it is too wide.
 * @param {string} label  what a screen reader tells
 * @param {...Node} parts */
export function scrolled(label, ...parts) {
  return h("div", { class: "scroll", tabindex: "0", role: "group", "aria-label": label }, h("table", {}, parts));
}

/** The verdict on a filter as a word in its colour; one whose innovations are smaller than stated is called cautious.
 * @param {string} verdict
 * @param {string} line  the first of its health, which says so */
export function badge(verdict, line) {
  const small = verdict === "consistent" && line.startsWith("consistent, ");
  const word = small ? "cautious" : verdict;
  return h("span", { class: `state ${word}` }, word);
}

/** The table of an estimator.
 * @param {any} table  see web/README.md */
export function summaryTable(table) {
  const sample = table.group === null ? null : swatch("line", () => groupColour(table.group));
  const health = table.below.find((/** @type {string} */ line) => line.startsWith(HEALTH)) ?? "";
  const state = table.state && badge(table.state, health.slice(HEALTH.length));
  const head = h("tr", {}, table.columns.map((/** @type {string} */ name) => h("th", { scope: "col" }, withUnit(name))));
  const marked = new Set(table.warnings.map((/** @type {number[]} */ [row, column]) => `${row},${column}`));
  const rows = table.rows.map((/** @type {string[]} */ [name, ...cells], /** @type {number} */ place) =>
    h(
      "tr",
      {},
      h("th", { scope: "row" }, withUnit(name)),
      cells.map((cell, at) => h("td", { class: marked.has(`${place},${at + 1}`) ? "warning" : null }, minus(plain(cell)))),
    ),
  );
  return h(
    "section",
    { class: `summary${table.wide ? " wide" : ""}` },
    h("h2", {}, sample, table.caption, state),
    scrolled(`Figures of ${table.caption}`, h("thead", {}, head), h("tbody", {}, rows)),
    h("div", {}, table.below.map((/** @type {string} */ sentence) => h("p", { class: "below" }, sentence))),
  );
}
