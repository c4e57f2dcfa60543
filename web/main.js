/** The entry: shows what documents the page holds. */

import { embedded, h } from "./dom.js";
import { reportPage } from "./report.js";

const place = /** @type {HTMLElement} */ (document.getElementById("page"));

try {
  const report = embedded("report");
  if (report) place.append(reportPage(report));
} catch (error) {
  place.append(h("p", { role: "alert", class: "wrong" }, `This page cannot be shown: ${error instanceof Error ? error.message : error}`));
  throw error;
}
