/** What every page has at its head and at its foot. */

import { h } from "./dom.js";
import { themeButton } from "./theme.js";

/** The head of a page.
 * @param {string} name
 * @param {string} title  below the name; empty: none
 * @param {string[]} facts
 * @param {import("./dom.js").Child[]} tools */
export function heading(name, title, facts, tools) {
  const texts = [h("h1", {}, name), title !== "" && h("p", { class: "title" }, title), h("p", { class: "facts" }, facts.join(" \u00b7 "))];
  return h("header", {}, h("div", {}, texts), h("div", { class: "tools" }, tools, themeButton()));
}

/** What a page comes from, for a reader who was sent it.
 * @param {string} version */
export function origin(version) {
  return h(
    "p",
    { class: "origin" },
    `insenv ${version ?? ""} (Apache-2.0) simulates vehicles with their inertial sensors, aligns and navigates them, and shows each error beside its theoretical limit. `,
    h("code", {}, "pip install '.[plot]'"),
    " in a checkout installs it; docs/estimators there has a page on each estimator.",
  );
}
