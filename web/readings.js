/** The numbers of a live page: now, of the truth and of each estimator; and at the end, as `insenv run` prints them. */

import { h } from "./dom.js";
import { fixed, number } from "./numbers.js";
import { channelName } from "./livepanels.js";
import { summaryTable } from "./tables.js";
import { groupColour, onTheme } from "./theme.js";

const LABELS = {
  roll_deg: "roll [deg]",
  pitch_deg: "pitch [deg]",
  heading_deg: "heading [deg]",
  north_m: "north [m]",
  east_m: "east [m]",
  down_m: "down [m]",
  vn_mps: "vn [m/s]",
  ve_mps: "ve [m/s]",
  vd_mps: "vd [m/s]",
};

/** The table of numbers now.
 * @param {any} live
 * @param {(name: string) => any} at */
export function readings(live, at) {
  const channels = [...new Set(/** @type {string[]} */ (live.estimators.flatMap((/** @type {any} */ one) => one.channels)))];
  const truths = [
    ...["attitude", "offset_n", "velocity_n"].flatMap((name, block) =>
      [0, 1, 2].map((k) => ({ channel: Object.keys(LABELS)[3 * block + k], place: at(name).at + k })),
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
    const [title, unit] = channelName(channel);
    const decimals = unit === "m" ? 2 : 3;
    const figures = live.estimators.map((/** @type {any} */ { prefix, channels: own, stated }) => {
      const [error, sigma] = [own.indexOf(channel), stated.indexOf(channel)];
      const value = (/** @type {string} */ row, /** @type {number} */ k) =>
        k < 0 ? h("td", {}) : cell((y) => number(y[at(prefix + row).at + k]).replace("-", "\u2212"));
      return [value("error", error), stated.length > 0 && value("sigma", sigma)];
    });
    return h(
      "tr",
      {},
      h("th", { scope: "row" }, title.replace(" error", ""), h("span", { class: "unit" }, ` ${unit}`)),
      truth
        ? cell((y) => fixed(channel === "heading_deg" ? (y[truth.place] + 360) % 360 : y[truth.place], decimals))
        : h("td", {}),
      figures.flat(),
    );
  });
  const filters = live.estimators.filter((/** @type {any} */ one) => at(`${one.prefix}fix_count`));
  const health = filters.map((/** @type {any} */ one) => {
    const line = h("p", { class: "below" });
    const read = (/** @type {Float64Array} */ y, /** @type {string} */ name) => {
      const row = at(one.prefix + name);
      return y.subarray(row.at, row.at + row.size).reduce((sum, value) => sum + value, 0);
    };
    cells.push({
      cell: line,
      text: (y) => {
        const [fixes, refused, nis, count] = ["fix_count", "fix_refused_count", "nis_used", "nis_used_count"].map((name) =>
          read(y, name),
        );
        return `${one.id}: ${fixes} fixes, ${refused} refused${count > 0 ? `, mean NIS ${number(nis / count)} (1: innovations as stated)` : ""}`;
      },
    });
    return line;
  });
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
    draw: (/** @type {Float64Array} */ y) => {
      for (const one of cells) {
        const text = one.text(y);
        if (one.cell.textContent !== text) one.cell.textContent = text;
      }
    },
  };
}

/** The tables at the end of a run: final, rms and largest error as `insenv run` prints them.
 * @param {any} live
 * @param {(name: string) => any} at
 * @param {import("./history.js").Recorded} history */
export function endTables(live, at, history) {
  const last = history.count() - 1;
  const time = at("time").at;
  return live.estimators.map(
    (/** @type {any} */ { id, prefix, kind, channels, stated, needs_s: needs }, /** @type {number} */ group) => {
      const from = kind === "navigation" ? 0 : 0.75 * history.value(time, last);
      const rms = (/** @type {number} */ place) => {
        let [sum, count, largest] = [0, 0, 0];
        for (let record = 0; record <= last; record++) {
          if (history.value(time, record) < from - 1e-9) continue;
          const value = history.value(place, record);
          sum += value * value;
          largest = Math.max(largest, Math.abs(value));
          count++;
        }
        return { rms: Math.sqrt(sum / count), largest };
      };
      /** @type {string[]} */
      const sure = [];
      const rows = channels.map((/** @type {string} */ channel, /** @type {number} */ k) => {
        const place = at(`${prefix}error`).at + k;
        const found = rms(place);
        const own = stated.indexOf(channel);
        const sigma = own < 0 ? null : rms(at(`${prefix}sigma`).at + own).rms;
        if (sigma && found.rms > live.too_sure * sigma) sure.push(`${channel.replace(/_.*/, "")} ${number(found.rms / sigma)}`);
        const cells = [history.value(place, last), found.rms, found.largest, ...(sigma === null ? [] : [sigma])];
        return [LABELS[/** @type {keyof typeof LABELS} */ (channel)], ...cells.map(number)];
      });
      const below = from > 0 ? [`Statistics from ${number(from)} s on`] : [];
      if (sure.length && needs <= live.duration_s) {
        below.push(`the errors are larger than this estimator states, rms over stated sigma: ${sure.join(", ")}`);
      }
      return summaryTable({
        caption: id,
        columns: ["error", "final", "rms", "max", ...(stated.length ? ["stated"] : [])],
        rows,
        group,
        below,
        warnings: [],
        state: "",
      });
    },
  );
}
