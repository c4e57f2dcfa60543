/** The numbers of a live page now: of the truth and of each estimator, and the health of each filter. */

import { fill, h } from "./dom.js";
import { healthNow } from "./judge.js";
import { fixed, minus, number } from "./numbers.js";
import { badge } from "./tables.js";
import { groupColour, onTheme } from "./theme.js";

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
  const heads = live.estimators.map((/** @type {any} */ one, /** @type {number} */ group) => {
    const swatch = h("i", { class: "swatch line", "aria-hidden": "true" });
    const paint = () => (swatch.style.background = groupColour(group));
    onTheme(paint);
    paint();
    const wide = one.stated.length > 0 ? 2 : 1;
    return {
      name: h("th", { scope: "colgroup", colspan: wide }, swatch, ` ${one.id}`),
      kinds: ["error", "sigma"].slice(0, wide).map((kind) => h("th", { scope: "col" }, kind)),
    };
  });
  const rows = channels.map((channel) => {
    const truth = truths.find((one) => one.channel === channel);
    const { title, unit } = live.channels[channel];
    const decimals = unit === "m" ? 2 : 3;
    const figures = live.estimators.map((/** @type {any} */ { prefix, channels: own, stated }) => {
      const [error, sigma] = [own.indexOf(channel), stated.indexOf(channel)];
      const value = (/** @type {string} */ row, /** @type {number} */ k) =>
        k < 0 ? h("td", {}) : cell((y) => minus(number(y[at(prefix + row).at + k])));
      return [value("error", error), stated.length > 0 && value("sigma", sigma)];
    });
    return h(
      "tr",
      {},
      h("th", { scope: "row" }, title, h("span", { class: "unit" }, ` ${unit}`)),
      truth
        ? cell((y) => fixed(channel === "heading_deg" ? (y[truth.place] + 360) % 360 : y[truth.place], decimals))
        : h("td", {}),
      figures.flat(),
    );
  });
  const filters = live.estimators.filter((/** @type {any} */ one) => one.health);
  const health = filters.map(() => h("p", { class: "below" }));
  const head = [
    h(
      "tr",
      {},
      h("td", { colspan: 2 }),
      heads.map((/** @type {any} */ one) => one.name),
    ),
    h(
      "tr",
      {},
      h("th", { scope: "col" }, "now"),
      h("th", { scope: "col" }, "true"),
      heads.flatMap((/** @type {any} */ one) => one.kinds),
    ),
  ];
  const element = h(
    "section",
    { class: "readings" },
    h(
      "div",
      { class: "scroll", tabindex: "0", role: "group", "aria-label": "Numbers now" },
      h("table", {}, h("thead", {}, head), h("tbody", {}, rows)),
    ),
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
        const found = healthNow(live, one, at, history);
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
