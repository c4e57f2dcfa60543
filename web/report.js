/** The page of a run, a replay or a campaign: tables, and sections of panels, from its document (web/README.md). */

import { arraysOf, drawn } from "./arrays.js";
import { h, sectionOf } from "./dom.js";
import { intervalsPanel } from "./intervals.js";
import { legend, othersOf } from "./legend.js";
import { heading, origin } from "./origin.js";
import { TIME, makeSpan, spanControls } from "./span.js";
import { summaryTable } from "./tables.js";
import { timePlot } from "./timeplot.js";
import { trackPlot } from "./track.js";

/**
 * @param {any} report  its document
 * @param {Node | null} [live]  the button that makes a run live
 * @returns {HTMLElement}
 */
export function reportPage(report, live = null) {
  const array = arraysOf(report.arrays);
  const axis = report.axis ?? TIME;
  const names = report.legend.map((/** @type {{name: string}} */ one) => one.name);
  const panels = report.sections.flatMap((/** @type {any} */ section) => section.panels);
  const timed = panels.filter((/** @type {any} */ panel) => panel.type === "time");
  const ends = timed.map((/** @type {any} */ panel) => array(panel.x));
  const end = Math.max(1e-9, ...ends.map((/** @type {Float32Array} */ x) => x[x.length - 1] ?? 0));
  const begin = Math.min(end, ...ends.map((/** @type {Float32Array} */ x) => x[0] ?? 0));
  const span = makeSpan(begin < 0.02 * end && !axis.log ? 0 : begin, end);
  /** @type {{element: HTMLElement, show: (group: number, shown: boolean) => void}[]} */
  const plots = [];
  const sections = report.sections.map((/** @type {any} */ section) => {
    const made = section.panels.map((/** @type {any} */ panel) => drawnPanel(panel, array, span, names, axis));
    plots.push(...made);
    return sectionOf(section, made.map((/** @type {any} */ plot) => plot.element));
  });
  const show = (/** @type {number} */ group, /** @type {boolean} */ shown) => plots.forEach((plot) => plot.show(group, shown));
  const key = legend(report.legend, othersOf(panels, report.truth, report.shares), show);
  const shown = spanControls(span, axis, timed.find((/** @type {any} */ panel) => panel.from_s)?.from_s ?? null);
  return h(
    "div",
    { class: "frame" },
    heading(report.name, report.title, report.facts, [live]),
    h(
      "main",
      {},
      h("div", { class: `tables${report.tables.length > 1 ? " several" : ""}` }, report.tables.map(summaryTable)),
      h("p", { class: "quiet" }, report.explained.join(" ")),
      report.notes.length > 0 &&
        h("ul", { class: "notes" }, report.notes.map((/** @type {string} */ note) => h("li", {}, note))),
      panels.length > 0 && h("div", { class: "bar" }, key, shown),
      sections,
    ),
    h("footer", {}, "Drag over a plot to zoom, double-click for the whole run.", origin(report.version)),
  );
}

/** A panel by its type.
 * @param {any} panel
 * @param {(place: number) => Float32Array} array
 * @param {import("./span.js").Span} span
 * @param {string[]} names
 * @param {import("./span.js").Axis} axis */
function drawnPanel(panel, array, span, names, axis) {
  if (panel.type === "track") return track(panel, array, span, names);
  if (panel.type === "intervals") return intervalsPanel(panel);
  return timePlot(decoded(panel, array), span, names, axis);
}

/** A panel over time with its values in place of the numbers of its arrays.
 * @param {any} panel
 * @param {(place: number) => Float32Array} array
 * @returns {import("./timeplot.js").Panel} */
function decoded(panel, array) {
  const curves = panel.curves.map((/** @type {any} */ curve) => {
    const { kind, group, strength } = curve;
    if (kind === "between") return { kind, group, strength, low: drawn(array(curve.low)), high: drawn(array(curve.high)) };
    if (kind !== "band") return { kind, group, y: drawn(array(curve.y)) };
    const half = array(curve.half);
    const centre = curve.centre === null ? new Float32Array(half.length) : array(curve.centre);
    return {
      kind,
      group,
      low: drawn(half.map((value, place) => centre[place] - value)),
      high: drawn(half.map((value, place) => centre[place] + value)),
    };
  });
  return { ...panel, x: Array.from(array(panel.x)), curves };
}

/** The track; it shows the part of the run that the plots over time show.
 * @param {any} panel
 * @param {(place: number) => Float32Array} array
 * @param {import("./span.js").Span} span
 * @param {string[]} names */
function track(panel, array, span, names) {
  const x = array(panel.x);
  const lines = panel.tracks.map((/** @type {any} */ line) => ({
    group: line.group,
    east: array(line.east),
    north: array(line.north),
  }));
  const refused = panel.refused.flatMap((/** @type {any} */ mark) => {
    const line = lines.find((/** @type {any} */ one) => one.group === mark.group);
    return line
      ? mark.at.map((/** @type {number} */ at) => ({ at, group: mark.group, east: line.east[at], north: line.north[at] }))
      : [];
  });
  const within = () => {
    const [from, to] = span.shown();
    const places = /** @type {[number, number]} */ ([
      x.findIndex((t) => t >= from - 1e-6),
      x.findLastIndex((t) => t <= to + 1e-6) + 1,
    ]);
    return { lines, places, refused: refused.filter((/** @type {any} */ fix) => fix.at >= places[0] && fix.at < places[1]) };
  };
  const labels = lines.map((/** @type {any} */ line) => (line.group < 0 ? "the truth" : names[line.group])).join(", ");
  const plot = trackPlot(panel.title, within(), `Tracks of ${labels}; ${refused.length} places of refused fixes.`);
  span.onChange(() => plot.update(within()));
  return plot;
}
