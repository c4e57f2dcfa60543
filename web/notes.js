/** What must be said of the scenario and of the estimators, and of what the page has changed since. */

import { fill, h } from "./dom.js";

/** @param {any} live */
export function notesPanel(live) {
  const changed = h("p", { class: "quiet", id: "changed" });
  const list = h("ul", { class: "notes" });
  let shown = "";
  /** @type {string[] | null} */
  let listed = null;
  const show = (/** @type {string[]} */ notes) => {
    if (notes === listed) return;
    listed = notes;
    list.hidden = notes.length === 0;
    fill(list, ...notes.map((note) => h("li", {}, note)));
  };
  show(live.notes);
  return {
    element: h("div", { "aria-live": "polite" }, changed, list),
    /** @param {{settings: boolean, commands: boolean}} changes
     * @param {string[] | null} renewed  the notes on the settings as they are; null: not known */
    show: (changes, renewed) => {
      show(renewed ?? live.notes);
      const what = [changes.settings && "settings", changes.commands && "commands"].filter(Boolean).join(" and ");
      const limit = live.limit ? "; no limit is known for them" : "";
      const below = live.notes.length && !renewed ? " The notes below are those of the scenario as prepared: some may not hold now." : "";
      const text = what && `The ${what} have changed${limit}.${below}`;
      const lacking = changes.settings && !renewed;
      if (`${text} ${lacking}` === shown) return; // a screen reader tells it once
      shown = `${text} ${lacking}`;
      const ask = [" The notes on these settings come with ", h("code", {}, "insenv run"), " of the downloaded scenario."];
      fill(changed, text, ...(lacking ? ask : []));
    },
  };
}
