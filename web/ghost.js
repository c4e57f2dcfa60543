/** The last run with other settings: it stays as thin lines on the plots and as a column of the tables at the end. */

import { button, h } from "./dom.js";
import { conditions } from "./livestate.js";
import { swatch } from "./theme.js";

const NAMED = 3; // settings that are named, of those that differ

/** @typedef {{state: import("./address.js").State, history: import("./history.js").Recorded}} LastRun */

/** What a run had that another has not: its seed, values of settings, commands; empty if nothing differs.
 * @param {any} live
 * @param {import("./address.js").State} was
 * @param {import("./address.js").State} now
 * @returns {string} */
export function difference(live, was, now) {
  const parts = was.seed === now.seed ? [] : [`seed ${was.seed}`];
  for (const { key, label, unit, value } of live.controls) {
    const before = was.values[key] ?? value;
    if (before !== (now.values[key] ?? value)) parts.push(`${label} ${before ?? "drawn"}${unit ? ` ${unit}` : ""}`);
  }
  if (parts.length > NAMED) parts.splice(NAMED - 1, parts.length, `${parts.length - NAMED + 1} other settings`);
  const cuts = (/** @type {any} */ state) => JSON.stringify(live.outages.map((/** @type {any} */ one) => state.values[one.key]));
  if (cuts(was) !== cuts(now)) parts.push("other outages");
  const commands = (/** @type {any} */ state) => conditions(live, { ...state, values: {} });
  if (commands(was) !== commands(now)) parts.push("other commands");
  return parts.join(", ");
}

/** Keeps the last run, and says which it is.
 * @param {any} live
 * @param {(run: LastRun | null) => void} draw */
export function lastRun(live, draw) {
  /** @type {LastRun | null} */
  let run = null;
  let told = "";
  const text = h("span", { id: "last-run" });
  const element = h(
    "div",
    { class: "entry last", hidden: true },
    swatch("line thin"),
    text,
    button("Forget", () => show(null), { class: "quiet", id: "forget" }),
  );
  const show = (/** @type {LastRun | null} */ other) => {
    if (other !== run) draw((run = other));
    element.hidden = !run;
    text.textContent = run ? `last run: ${told}` : "";
  };
  return {
    element,
    /** A run begins after another.
     * @param {LastRun} before
     * @param {import("./address.js").State} now */
    begin: (before, now) => {
      const other = before.history.count() > 1 && difference(live, before.state, now) ? before : run;
      told = other ? difference(live, other.state, now) : "";
      show(told ? other : null);
    },
    run: () => run,
    told: () => told,
  };
}
