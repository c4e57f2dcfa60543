/** A cloud of units: the errors of many seeds against the limit. */

import { button, fill, h } from "./dom.js";
import { between } from "./history.js";
import { thresholdOf } from "./livepanels.js";
import { number } from "./numbers.js";
import { makeSpan } from "./span.js";
import { summaryTable } from "./tables.js";
import { timePlot } from "./timeplot.js";

const UNITS = 64;

/**
 * @param {any} live
 * @param {(units: number) => void} start  ask for so many units
 */
export function cloudPanel(live, start) {
  /** @type {{errors: Float64Array[]}[]} */
  let units = [];
  let [interval, limited] = [1, true];
  const { channels } = live.estimators[0];
  const chosen = { estimator: 0, channel: channels.includes("heading_deg") ? "heading_deg" : channels[0] };
  const go = button(`${UNITS} units`, () => start(UNITS), { id: "cloud" });
  const progress = h("output", { class: "quiet", id: "cloud-done" });
  const place = h("div", {});
  const estimator = h(
    "select",
    { "aria-label": "Estimator" },
    live.estimators.map((/** @type {any} */ one, /** @type {number} */ at) => h("option", { value: at }, one.id)),
  );
  const channel = h("select", { "aria-label": "Error" });
  const offer = () => {
    fill(
      channel,
      ...live.estimators[chosen.estimator].channels.map((/** @type {string} */ name) =>
        h("option", { value: name, selected: name === chosen.channel }, `${live.channels[name].title} error, ${live.channels[name].unit}`),
      ),
    );
  };
  offer();
  const choice = h("div", { class: "pair", hidden: true }, estimator, channel);
  estimator.addEventListener("change", () => {
    chosen.estimator = Number(estimator.value);
    if (!live.estimators[chosen.estimator].channels.includes(chosen.channel))
      chosen.channel = live.estimators[chosen.estimator].channels[0];
    offer();
    draw();
  });
  channel.addEventListener("change", () => {
    chosen.channel = channel.value;
    draw();
  });
  const element = h(
    "section",
    { class: "cloud" },
    h("h2", {}, "Many units"),
    h(
      "p",
      { class: "quiet" },
      `One run shows one unit on one day. ${UNITS} seeds show what to expect. The errors of an optimal estimator lie within the limit for 68 % of the units.`,
    ),
    h("div", { class: "pair" }, go, progress, choice),
    place,
  );
  const column = (/** @type {{errors: Float64Array[]}} */ unit, /** @type {string} */ name) => {
    const { channels } = live.estimators[chosen.estimator];
    const [k, width] = [channels.indexOf(name), channels.length];
    const values = unit.errors[chosen.estimator];
    return Array.from({ length: values.length / width }, (_, record) => values[record * width + k]);
  };
  const draw = () => {
    if (!units.length) return fill(place);
    const { channel: name } = chosen;
    const { title, unit } = live.channels[name];
    /** @type {any[]} */
    const curves = units.map((one) => ({ kind: "thin", group: chosen.estimator, y: column(one, name) }));
    const x = curves[0].y.map((/** @type {number} */ _, /** @type {number} */ k) => (k + 1) * interval);
    const limit = limited ? live.limit?.sigma[name] : null;
    const limits = () => x.map((/** @type {number} */ time) => between(live.limit.time_s, limit, time));
    if (limit) curves.push({ kind: "limit", group: -1, y: limits() });
    const panel = { title: `${title} error of ${units.length} units`, unit, threshold: thresholdOf(live, name), x, curves };
    const plot = timePlot(panel, makeSpan(0, x.at(-1) ?? 1), live.estimators.map((/** @type {any} */ one) => one.id));
    fill(place, plot.element, summaryTable(figures(live, units, chosen.estimator, column, limited)));
  };
  return {
    element,
    begin: () => {
      units = [];
      progress.textContent = `0 of ${UNITS}`;
      go.disabled = true;
    },
    limited: (/** @type {boolean} */ shown) => (limited = shown),
    take: (/** @type {any} */ message) => {
      units.push({ errors: message.errors });
      interval = message.interval_s;
      progress.textContent = `${message.done} of ${message.units}`;
      choice.hidden = false;
      if (message.done === message.units) {
        go.disabled = false;
        draw();
      } else if (message.done < 8 || message.done % 8 === 0) draw();
    },
    stop: () => {
      if (go.disabled) progress.textContent = "";
      go.disabled = false;
    },
    clear: () => {
      units = [];
      progress.textContent = "";
      choice.hidden = true;
      draw();
    },
  };
}

/** The errors of the units at the end beside the limit.
 * @param {any} live
 * @param {{errors: Float64Array[]}[]} units
 * @param {number} group
 * @param {(unit: any, name: string) => number[]} column
 * @param {boolean} limited */
export function figures(live, units, group, column, limited) {
  const limits = limited && live.limit ? live.limit.sigma : {};
  const rows = live.estimators[group].channels.map((/** @type {string} */ name) => {
    const ends = units.map((unit) => column(unit, name).at(-1) ?? NaN);
    const rms = Math.sqrt(ends.reduce((sum, value) => sum + value * value, 0) / ends.length);
    const largest = Math.max(...ends.map(Math.abs));
    const limit = limits[name]?.at(-1);
    return [
      live.channels[name].label,
      number(rms),
      number(largest),
      ...(limit === undefined ? [] : [number(limit), limit < live.limit.floor[name] ? "-" : number(rms / limit)]),
    ];
  });
  const beside = Object.keys(limits).length ? ["limit", "rms/limit"] : [];
  return {
    caption: `${live.estimators[group].id}: errors at the end over ${units.length} units`,
    columns: ["error", "rms", "largest", ...beside],
    rows,
    group,
    below: [],
    warnings: [],
    state: "",
  };
}
