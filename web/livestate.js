/** The state of a live page: which settings differ, when sensors are cut off; and what leaves the page: files and links. */

import { h } from "./dom.js";

/** The values with some changed; a value of the scenario itself is left out.
 * @param {any} live
 * @param {Record<string, any>} before
 * @param {Record<string, any>} values */
export function changed(live, before, values) {
  const now = { ...before, ...values };
  for (const [key, value] of Object.entries(values)) {
    const control = live.controls.find((/** @type {any} */ one) => one.key === key);
    if (control && control.value === value) delete now[key];
    // a grade replaces the single figures of its section
    if (control?.options)
      for (const other of Object.keys(now))
        if (other !== key && other.startsWith(`${key.split(".")[0]}.`) && !other.endsWith("outages_s")) delete now[other];
  }
  return now;
}

/** The times without a sensor, s.
 * @param {any} live
 * @param {Record<string, any>} values
 * @param {string} sensor
 * @returns {[number, number][]} */
export function outagesOf(live, values, sensor = "gnss") {
  const outage = live.outages.find((/** @type {any} */ one) => one.sensor === sensor);
  return outage ? (values[outage.key] ?? live.values[sensor]?.outages_s ?? []) : [];
}

/** Since when each sensor is cut off at a time, s; null: it is not.
 * @param {any} live
 * @param {Record<string, any>} values
 * @param {number} time  s
 * @returns {Record<string, number | null>} */
export function cutNow(live, values, time) {
  return Object.fromEntries(
    live.outages.map((/** @type {any} */ { sensor }) => {
      const now = outagesOf(live, values, sensor).find(([begin, end]) => time >= begin - 0.01 && time < end);
      return [sensor, now ? now[0] : null];
    }),
  );
}

/** The state as the document has it.
 * @param {any} live
 * @returns {import("./address.js").State} */
export function preparedState(live) {
  return { seed: live.seed, values: {}, commands: undefined };
}

/** What of the scenario a state changes, beside the seed: settings, commands.
 * @param {any} live
 * @param {import("./address.js").State} state */
export function changesOf(live, { values, commands }) {
  const unchanged = conditions(live, { ...preparedState(live), commands }) === conditions(live, preparedState(live));
  return { settings: Object.keys(values).length > 0, commands: !unchanged };
}

/** The notes on a state of which they are known: on the document's own settings, and on those in which one choice is another.
 * @param {any} live
 * @param {import("./address.js").State} state
 * @returns {string[] | null} */
export function notesOf(live, { values }) {
  const [key, ...more] = Object.keys(values);
  if (key === undefined) return live.notes;
  const control = more.length ? null : live.controls.find((/** @type {any} */ one) => one.key === key);
  return control?.options?.find((/** @type {any} */ one) => one.value === values[key])?.notes ?? null;
}

/** All of a state but the seed, to be compared.
 * @param {any} live
 * @param {import("./address.js").State} state
 * @returns {string} */
export function conditions(live, { values, commands }) {
  return JSON.stringify([values, commands ?? live.commands?.given ?? []]);
}

/** Offer a text as a file.
 * @param {string} name
 * @param {string} text */
export function download(name, text) {
  const address = URL.createObjectURL(new Blob([text], { type: "application/toml" }));
  const anchor = h("a", { href: address, download: name });
  anchor.click();
  setTimeout(() => URL.revokeObjectURL(address), 1000);
}

/** Whether the address of this page leads others to it: that of a file on a disk does not. */
export function shared() {
  return location.protocol !== "file:";
}

/** Copy the address of the page.
 * @param {HTMLElement} element  the button, which says so */
export async function copy(element) {
  try {
    await navigator.clipboard.writeText(location.href);
    element.textContent = "Link copied";
  } catch {
    element.textContent = "The link is in the address bar";
  }
  setTimeout(() => (element.textContent = "Copy link"), 2000);
}
