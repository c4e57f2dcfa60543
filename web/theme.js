/** Light and dark: the colours that canvases use are the custom properties of the style sheet. */

import { h } from "./dom.js";

const KEPT = "insenv-theme";
const NAMES = { auto: "Theme: system", light: "Theme: light", dark: "Theme: dark" };
/** @type {Set<() => void>} */
const listeners = new Set();
/** @type {Map<string, string>} */
let known = new Map();

/** A colour of the style sheet by the name of its custom property.
 * @param {string} name
 * @returns {string} */
export function colour(name) {
  let value = known.get(name);
  if (value === undefined) {
    value = getComputedStyle(document.documentElement).getPropertyValue(`--${name}`).trim();
    known.set(name, value);
  }
  return value;
}

/** The colour of a group of curves: of an estimator by its place, of the truth for -1.
 * @param {number} group */
export function groupColour(group) {
  return colour(group < 0 ? "truth" : `c${group % 13}`);
}

/** A colour with this opacity (0 to 1).
 * @param {string} hex
 * @param {number} opacity */
export function faint(hex, opacity) {
  const part = Math.round(255 * opacity).toString(16);
  return `${hex}${part.padStart(2, "0")}`;
}

/** Call `act` after each change of the colours.
 * @param {() => void} act */
export function onTheme(act) {
  listeners.add(act);
}

/** A sample of how something is drawn; its colour follows the theme.
 * @param {string} kind  a class of the style sheet
 * @param {() => string} [paint] */
export function swatch(kind, paint) {
  const element = h("i", { class: `swatch ${kind}`, "aria-hidden": "true" });
  if (!paint) return element;
  const show = () => (element.style.background = paint());
  onTheme(show);
  show();
  return element;
}

function changed() {
  known = new Map();
  for (const act of listeners) act();
}

/** The button that goes from the system's theme to light and dark; keeps the choice where the browser lets it. */
export function themeButton() {
  let chosen = "auto";
  try {
    chosen = localStorage.getItem(KEPT) ?? "auto";
  } catch {
    // a page from disk may have no storage: the choice then lasts as long as the page
  }
  const element = h("button", { type: "button", class: "quiet" });
  const system = matchMedia("(prefers-color-scheme: dark)");
  const apply = () => {
    document.documentElement.dataset.theme = chosen === "auto" ? (system.matches ? "dark" : "light") : chosen;
    element.textContent = NAMES[/** @type {keyof typeof NAMES} */ (chosen)] ?? NAMES.auto;
    changed();
  };
  element.addEventListener("click", () => {
    const order = Object.keys(NAMES);
    chosen = order[(order.indexOf(chosen) + 1) % order.length];
    try {
      localStorage.setItem(KEPT, chosen);
    } catch {
      // as above
    }
    apply();
  });
  system.addEventListener("change", apply);
  addEventListener("beforeprint", () => {
    document.documentElement.dataset.theme = "light"; // paper is white
    changed();
  });
  addEventListener("afterprint", apply);
  apply();
  return element;
}
