/** The numbers of a live page now: of the truth and of each estimator, and the health of each filter. */

import { fill, h } from "./dom.js";
import { healthNow } from "./judge.js";
import { fixed, minus, number, plain } from "./numbers.js";
import { badge, scrolled } from "./tables.js";
import { groupColour, swatch } from "./theme.js";

/** The table of numbers now.
 * @param {any} live
 * @param {(name: string) => any} at */
export function readings(live, at) {
  const channels = [...new Set(/** @type {string[]} */ (live.estimators.flatMap((/** @type {any} */ one) => one.channels)))];
  const truths = [
    ...["attitude", "offset_n", "velocity_n"].flatMap((name, block) =>
      [0, 1, 2].map((k) => ({ channel: Object.keys(live.channels)[3 * block + k], place: at(name).at + k })),
    ),
  ];
  /** @type {{cell: HTMLElement, text: (y: Float64Array) => string}[]} */
  const cells = [];
  const cell = (/** @type {(y: Float64Array) => string} */ text) => {
    const element = h("td", {});
    cells.push({ cell: element, text });
    return element;
  };
  const several = live.estimators.length > 1;
  const named = (/** @type {string} */ id, /** @type {number} */ group) =>
    h("th", { scope: "row", class: "of", title: id }, swatch("line", () => groupColour(group)), h("span", { class: "hidden" }, id));
  // one line an estimator: the table is as wide for several as for one
  const rows = channels.map((channel) => {
    const truth = truths.find((one) => one.channel === channel);
    const { title, unit } = live.channels[channel];
    const decimals = unit === "m" ? 2 : 3;
    const lines = live.estimators.filter((/** @type {any} */ one) => one.channels.includes(channel));
    const true_ = truth
      ? cell((y) => fixed(channel === "heading_deg" ? (y[truth.place] + 360) % 360 : y[truth.place], decimals))
      : h("td", {});
    const heading = [h("th", { scope: "rowgroup" }, title, h("span", { class: "unit" }, ` ${unit}`)), true_];
    for (const one of heading) one.setAttribute("rowspan", lines.length);
    return lines.map((/** @type {any} */ { id, prefix, channels: own, stated, group }, /** @type {number} */ line) => {
      const value = (/** @type {string} */ row, /** @type {number} */ k) =>
        k < 0 ? h("td", {}) : cell((y) => minus(plain(number(y[at(prefix + row).at + k]))));
      const figures = [value("error", own.indexOf(channel)), value("sigma", stated.indexOf(channel))];
      return h("tr", {}, line === 0 && heading, several && named(id, group), figures);
    });
  });
  const filters = live.estimators.filter((/** @type {any} */ one) => one.health);
  const health = filters.map(() => h("p", { class: "below" }));
  const column = (/** @type {string} */ text) => h("th", { scope: "col" }, text);
  const hidden = several && h("th", { scope: "col" }, h("span", { class: "hidden" }, "estimator"));
  const head = h("tr", {}, column("now"), column("true"), hidden, column("error"), column("sigma"));
  const element = h(
    "section",
    { class: "readings" },
    scrolled("Numbers now", h("thead", {}, head), ...rows.map((lines) => h("tbody", {}, lines))),
    health,
  );
  return {
    element,
    draw: (/** @type {Float64Array} */ y, /** @type {import("./history.js").Recorded} */ history) => {
      for (const one of cells) {
        const text = one.text(y);
        if (one.cell.textContent !== text) one.cell.textContent = text;
      }
      filters.forEach((/** @type {any} */ one, /** @type {number} */ place) => {
        const found = healthNow(live, one, history);
        const state = found && badge(found.verdict, found.lines[0]);
        fill(health[place], found ? `${one.id} ` : `${one.id}:`, state, ` ${found ? besideVerdict(found.lines) : "nothing measured yet"}`);
      });
    },
  };
}

/** The lines of a health as one text that stands beside its verdict and does not repeat it.
 * @param {string[]} lines
 * @returns {string} */
export function besideVerdict([first, ...others]) {
  return [first.replace(/^[a-z]+(: |, | (?=within)|$)/, ""), ...others].filter(Boolean).join("; ");
}
