/** The story of a scenario: sentences that follow the run. */

import { button, h } from "./dom.js";

/** The sentence for a time: that which began last. One after "cut" holds only while GNSS is cut, one after "return" only while it is back.
 * In a cut of which the story tells, those counted from the start do not begin: they can speak of fixes.
 * @param {{after?: string, at_s?: number, text: string}[]} story
 * @param {[number, number][]} outages  of GNSS, s
 * @param {number} time  s
 * @returns {string} */
export function captionAt(story, outages, time) {
  const now = outages.find(([begin, end]) => begin <= time && time < end);
  const ends = outages.map(([, end]) => end).filter((end) => end <= time);
  /** @type {Record<string, number | undefined>} */
  const from = { start: 0, cut: now?.[0], return: now || !ends.length ? undefined : Math.max(...ends) };
  const silent = now && story.some(({ after }) => after === "cut") ? now[0] : Infinity;
  let [text, latest] = ["", 0];
  for (const caption of story) {
    const begin = (from[caption.after ?? "start"] ?? Infinity) + (caption.at_s ?? 0);
    if ((caption.after ?? "start") === "start" && begin > silent) continue;
    if (begin <= time && begin >= latest) [text, latest] = [caption.text, begin];
  }
  return text;
}

/** The strip that tells them; a screen reader says each once.
 * @param {any[]} story */
export function storyStrip(story) {
  const spoken = h("p", { "aria-live": "polite", id: "caption" });
  const skip = button("Hide", () => show(spoken.hidden), { class: "quiet", id: "story", "aria-controls": "caption" });
  const show = (/** @type {boolean} */ shown) => {
    spoken.hidden = !shown;
    skip.textContent = shown ? "Hide" : "Show captions";
    skip.setAttribute("aria-expanded", String(shown));
  };
  show(true);
  return {
    element: story.length > 0 && h("section", { class: "story", "aria-label": "What happens" }, spoken, skip),
    /** @param {number} time  s
     * @param {[number, number][]} outages  of GNSS, s */
    at: (time, outages) => {
      const text = captionAt(story, outages, time);
      if (text !== spoken.textContent) spoken.textContent = text;
    },
  };
}
