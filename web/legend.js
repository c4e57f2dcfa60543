/** The legend: what the colours and lines mean; estimators can be hidden. */

import { button, h } from "./dom.js";
import { colour, groupColour, swatch } from "./theme.js";

/**
 * @param {{name: string, first?: boolean}[]} groups  the estimators (or what else has a colour); one without a name is not listed;
 *   first: listed before the others
 * @param {{kind: string, text: string}[]} others  what else is drawn: "truth", "limit", "band", "outage", "fix", "cross", "statistics"
 * @param {(group: number, shown: boolean) => void} show
 */
export function legend(groups, others, show) {
  const listed = [...groups.entries()].sort(([, a], [, b]) => Number(b.first ?? false) - Number(a.first ?? false));
  const entries = listed.map(([group, { name }]) => {
    if (!name) return null;
    const sample = swatch("line", () => groupColour(group));
    if (groups.length === 1) return h("span", { class: "entry" }, sample, name);
    const toggle = () => {
      const shown = element.getAttribute("aria-pressed") !== "true";
      element.setAttribute("aria-pressed", String(shown));
      show(group, shown);
    };
    const element = button(name, toggle, { class: "entry", "aria-pressed": "true", title: `Show or hide ${name}` });
    element.prepend(sample);
    return element;
  });
  for (const { kind, text } of others) {
    const sample = swatch(kind, kind === "band" ? () => `${colour("c0")}33` : undefined);
    if (kind === "cross") sample.textContent = "\u00d7";
    entries.push(h("span", { class: "entry" }, sample, text));
  }
  return h("div", { class: "legend", role: "group", "aria-label": "Legend" }, entries);
}

/** What a set of curves needs in the legend besides the estimators.
 * @param {{curves?: {kind: string, group: number}[], shade?: unknown[], from_s?: number | null, threshold?: number | null, refused?: {at: unknown[]}[]}[]} panels
 * @param {string} truth  "truth" or "reference"
 * @param {boolean} [shares]  whether bands between two curves are shares of runs
 * @returns {{kind: string, text: string}[]} */
export function othersOf(panels, truth, shares = false) {
  const curves = panels.flatMap((panel) => panel.curves ?? []);
  const some = (/** @type {string} */ kind) => curves.some((curve) => curve.kind === kind);
  const crossed = some("crosses") || panels.some((panel) => panel.refused?.some((one) => one.at.length));
  /** @type {[boolean, string, string][]} */
  const found = [
    [curves.some((curve) => curve.kind === "line" && curve.group < 0), "truth", truth],
    [some("limit"), "limit", "theoretical limit, \u00b11 sigma"],
    [some("band"), "band", "stated \u00b13 sigma"],
    [shares, "band", "68 % and 95 % of the runs"],
    [panels.some((panel) => panel.shade?.length), "outage", "no GNSS"],
    [panels.some((panel) => panel.from_s), "statistics", "time of the statistics"],
    [panels.some((panel) => panel.threshold), "linear", "scale: linear here, logarithmic beyond"],
    [crossed, "cross", "fix refused"],
  ];
  return found.filter(([drawn]) => drawn).map(([, kind, text]) => ({ kind, text }));
}
