/** What a page comes from, for a reader who was sent it. */

import { h } from "./dom.js";

/** @param {string} version */
export function origin(version) {
  return h(
    "p",
    { class: "origin" },
    `insenv ${version ?? ""} (Apache-2.0) simulates vehicles with their inertial sensors, aligns and navigates them, and shows each error beside its theoretical limit. `,
    h("code", {}, "pip install '.[plot]'"),
    " in a checkout installs it; docs/estimators there has a page on each estimator.",
  );
}
