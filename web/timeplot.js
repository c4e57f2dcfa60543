/** A panel over time: curves, bands, limits, shading, zoom by pointer and keys, the values under the pointer. */

import { stroked } from "./canvas.js";
import { columns, layout, ranged } from "./curves.js";
import { h, onceAFrame, panelOf, zoomKeys } from "./dom.js";
import { firstWhere } from "./history.js";
import { minus, number, plain, tick, ticks } from "./numbers.js";
import { marks, rangeOf, symlog } from "./scale.js";
import { TIME, along } from "./span.js";
import { colour, groupColour, onTheme } from "./theme.js";

/**
 * @typedef {import("./curves.js").Curve} Curve
 *
 * @typedef {object} Panel
 * @property {string} title
 * @property {string} unit
 * @property {number | null} [threshold]  up to which the scale is linear; null: it is linear throughout
 * @property {boolean} [log]
 * @property {number | null} [from_s]  where the statistics begin
 * @property {boolean} [positive]  the vertical scale begins at 0
 * @property {number | null} [most]  where the vertical scale ends; null: beyond the largest value
 * @property {number | null} [level]  what is expected, of a logarithmic scale
 * @property {boolean} [wraps]  angles in degrees: lines have a gap where they wrap
 * @property {[number, number][]} [shade]
 * @property {number[]} x
 * @property {Curve[]} curves
 */

const SYNC = "time";
const KEYS = "Drag or press plus and minus to zoom, arrow keys to move, 0 for the whole run.";
const LABEL = 13; // px from one label of the vertical axis to the next
const HEIGHT = 184;

/**
 * @param {Panel} panel
 * @param {import("./span.js").Span} span
 * @param {string[]} names  of the groups
 * @param {import("./span.js").Axis} axis
 */
export function timePlot(panel, span, names, axis = TIME) {
  const { threshold = null, log = false } = panel;
  let curves = panel.curves;
  const readout = h("output", { class: "readout" });
  const area = h("div", { class: "plot", tabindex: "0", role: "img", "aria-label": describe(panel, names, axis), onkeydown: keys(span) });
  const element = panelOf("", panel.title, panel.unit, readout, area);
  /** @type {Set<number>} */
  const hidden = new Set();
  const { series, bands, owners } = layout(curves, hidden, panel.wraps);
  const counted = () => ranged(curves, hidden);
  const range = (/** @type {any} */ u) => {
    const [from, to] = span.shown();
    const x = /** @type {number[]} */ (u.data[0]);
    const firstFrom = (/** @type {number} */ time) => firstWhere(x.length, (place) => x[place] >= time);
    const [low, high] = rangeOf(counted(), firstFrom(from), firstFrom(to + 1e-9) - 1, log, panel.level ?? null);
    return [panel.positive ? 0 : low, panel.most ?? high];
  };
  let pointed = /** @type {number | null} */ (null); // time of the cursor, s
  const point = () => pointed !== null && plot.setCursor({ left: plot.valToPos(pointed, "x"), top: 0 });
  const scale = threshold === null ? (log ? { distr: 3 } : {}) : { distr: 100, ...symlog(threshold) };
  const plot = new uPlot(
    {
      width: 300,
      height: HEIGHT,
      legend: { show: false },
      cursor: { drag: { x: true, y: false, setScale: false }, sync: { key: SYNC }, points: { size: 5 }, y: false },
      scales: { x: { time: false, range: () => span.shown(), ...(axis.log ? { distr: 3 } : {}) }, y: { auto: true, range, ...scale } },
      axes: [
        { ...scaleOf(30, (u, _, low, high) => axis.log ? marks(low, high, null, true, 0) : ticks(low, high, u.width / 90, axis.whole)), gap: 6 },
        { ...scaleOf(54, (u, _, low, high) => marks(low, high, threshold, log, 5)), values: apart },
      ],
      series: [{}, ...series],
      bands,
      hooks: {
        setSelect: [(/** @type {any} */ u) => selected(u, span)],
        setCursor: [(/** @type {any} */ u) => read(u, readout, owners, names, axis)],
        drawClear: [(/** @type {any} */ u) => background(u, panel)],
        draw: [() => point()], // the scale may be another
      },
    },
    columns(panel.x, curves),
    area,
  );
  plot.over.addEventListener("dblclick", () => span.reset());
  new ResizeObserver(onceAFrame(() => plot.setSize({ width: Math.max(120, area.clientWidth), height: HEIGHT }))).observe(area);
  const again = () => {
    const [min, max] = span.shown();
    plot.setScale("x", { min, max });
  };
  span.onChange(onceAFrame(again), false);
  onTheme(() => plot.redraw(false, true));
  return {
    element,
    show: (/** @type {number} */ group, /** @type {boolean} */ shown) => {
      if (shown) hidden.delete(group);
      else hidden.add(group);
      owners.forEach((owner, place) => owner.group === group && plot.setSeries(place + 1, { show: shown }));
      again();
    },
    /** Other values of the same curves.
     * @param {number[]} x
     * @param {Curve[]} now */
    update: (x, now) => {
      curves = now;
      plot.setData(columns(x, now), false);
      again();
    },
    /** @param {number | null} time  of the cursor, s; null: none */
    point: (time) => {
      pointed = time;
      if (time === null) plot.setCursor({ left: -10, top: -10 });
      else point();
    },
  };
}

/** What a screen reader tells of a panel: the last value of each estimator.
 * @param {Panel} panel
 * @param {string[]} names
 * @param {import("./span.js").Axis} axis */
function describe(panel, names, axis) {
  const unit = panel.unit === "1" ? "" : ` ${panel.unit}`;
  const ends = panel.curves
    .filter((curve) => curve.kind === "line" && curve.y?.length)
    .map((curve) => `${curve.group < 0 ? "truth" : names[curve.group]} ${number(curve.y?.[curve.y.length - 1])}${unit}`);
  return `${panel.title} over ${axis.name.toLowerCase()}. At the end: ${ends.join(", ") || "no value"}. ${KEYS}`;
}

/** @param {number} size
 * @param {(u: any, place: number, low: number, high: number) => number[]} splits */
function scaleOf(size, splits) {
  return {
    size,
    splits,
    filter: (/** @type {any} */ _, /** @type {number[]} */ values) => values, // uPlot leaves marks of logarithmic scales out
    values: (/** @type {any} */ _, /** @type {number[]} */ values) => values.map(tick),
    stroke: () => colour("muted"),
    font: "12px system-ui, sans-serif", // a whole number: uPlot scales the digits before "px" by the ratio of pixels
    gap: 3,
    grid: { stroke: () => colour("grid"), width: 1 },
    ticks: { show: false },
  };
}

/** The labels of marks of the vertical axis; one that would touch another, which is zero or larger, is left out.
 * @param {any} u
 * @param {number[]} values
 * @returns {string[]} */
function apart(u, values) {
  const importance = (/** @type {number} */ value) => Math.abs(value) || Infinity;
  /** @type {Map<number, number>} */
  const kept = new Map();
  for (const value of [...values].sort((a, b) => importance(b) - importance(a))) {
    const height = u.valToPos(value, "y");
    if ([...kept.values()].every((other) => Math.abs(height - other) >= LABEL)) kept.set(value, height);
  }
  return values.map((value) => (kept.has(value) ? tick(value) : ""));
}

/** Shade times without fixes and before the statistics; draw the line of zero (of the expected value on a logarithmic scale).
 * @param {any} u
 * @param {Panel} panel */
function background(u, { threshold = null, log = false, from_s: from = null, shade = [], level = null }) {
  const { ctx, bbox } = u;
  ctx.save();
  ctx.beginPath();
  ctx.rect(bbox.left, bbox.top, bbox.width, bbox.height);
  ctx.clip();
  const block = (/** @type {number} */ from, /** @type {number} */ to, /** @type {string} */ paint) => {
    const [left, right] = [u.valToPos(from, "x", true), u.valToPos(to, "x", true)];
    ctx.fillStyle = paint;
    ctx.fillRect(left, bbox.top, right - left, bbox.height);
  };
  if (from !== null) block(from, u.scales.x.max, colour("statistics"));
  for (const [begin, end] of shade) block(begin, Math.min(end, u.scales.x.max), colour("outage"));
  if (threshold !== null && u.scales.y.max > threshold) {
    const [top, bottom] = [u.valToPos(threshold, "y", true), u.valToPos(-threshold, "y", true)];
    ctx.fillStyle = colour("linear");
    ctx.fillRect(bbox.left, top, bbox.width, bottom - top);
  }
  const base = log ? level : 0;
  if (base !== null && u.scales.y.min < base && u.scales.y.max > base) {
    const height = Math.round(u.valToPos(base, "y", true)) + 0.5;
    stroked(ctx, colour("zero"), 1, [[bbox.left, height], [bbox.left + bbox.width, height]]);
  }
  ctx.restore();
}

/** Show the part that was drawn over.
 * @param {any} u
 * @param {import("./span.js").Span} span */
function selected(u, span) {
  const { left, width } = u.select;
  if (width > 3) span.set(u.posToVal(left, "x"), u.posToVal(left + width, "x"));
  if (width > 0) u.setSelect({ left: 0, top: 0, width: 0, height: 0 }, false);
}

/** Write the values under the pointer.
 * @param {any} u
 * @param {HTMLElement} readout
 * @param {Curve[]} owners
 * @param {string[]} names
 * @param {import("./span.js").Axis} axis */
function read(u, readout, owners, names, axis) {
  const place = u.cursor.idx;
  if (place === null || place === undefined) {
    readout.replaceChildren();
    return;
  }
  const parts = [h("span", { class: "at" }, `${minus(along(u.data[0][place], axis))} ${axis.unit}`)];
  /** @type {HTMLElement | null} */
  let before = null;
  owners.forEach((owner, index) => {
    const value = u.data[index + 1][place];
    const last = owner.kind === "last";
    if (!(last || owner.kind === "line") || value === null || value === undefined || !u.series[index + 1].show) return;
    const text = minus(plain(number(value)));
    const part = h("span", { title: `${names[owner.group] ?? "truth"}${last ? ", last run" : ""}` }, last ? `(${text})` : text);
    part.style.color = owner.group < 0 ? colour("muted") : groupColour(owner.group);
    if (last) before = part; // that of the run now stands first
    else parts.push(part, ...(before ? [before] : []));
    if (!last) before = null;
  });
  readout.replaceChildren(...parts);
}

/** @param {import("./span.js").Span} span */
function keys(span) {
  const arrows = { ArrowLeft: () => span.move(-0.2), ArrowRight: () => span.move(0.2) };
  return zoomKeys(() => span.zoom(0.5), () => span.zoom(2), span.reset, arrows);
}
