/** What must be said of the scenario and of the estimators, and of what the page has changed since. */

import { fill, h } from "./dom.js";

/** @param {any} live */
export function notesPanel(live) {
  const of = (/** @type {any} */ { id, notes }) => notes.map((/** @type {string} */ note) => `${id}: ${note}`);
  const notes = [...live.notes, ...live.estimators.flatMap(of)];
  const told = h("p", { class: "quiet", id: "changed" });
  const list = h(
    "ul",
    { class: "notes", hidden: notes.length === 0 },
    notes.map((note) => h("li", {}, note)),
  );
  let shown = "";
  return {
    element: h("div", { "aria-live": "polite" }, told, list),
    /** @param {{settings: boolean, commands: boolean}} changes */
    show: (changes) => {
      const what = [changes.settings && "settings", changes.commands && "commands"].filter(Boolean).join(" and ");
      const limit = live.limit ? "; no limit is known for them" : "";
      const below = notes.length ? " The notes below are those of the scenario as prepared: some may not hold now." : "";
      const text = what && `The ${what} have changed${limit}.${below}`;
      if (text === shown) return; // a screen reader tells it once
      shown = text;
      const ask = [" The notes on these settings come with ", h("code", {}, "insenv run"), " of the downloaded scenario."];
      fill(told, text, ...(changes.settings ? ask : []));
    },
  };
}
