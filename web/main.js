/** The entry: shows what documents the page holds. */

import { button, embedded, h } from "./dom.js";
import { livePage } from "./live.js";
import { reportPage } from "./report.js";

const place = /** @type {HTMLElement} */ (document.getElementById("page"));

try {
  const [report, live] = [embedded("report"), embedded("live")];
  const showLive = () => place.replaceChildren(livePage(live));
  if (report) place.append(reportPage(report, live && button("Make it live", showLive, { class: "main", id: "make-live" })));
  else if (live) showLive();
} catch (error) {
  place.append(
    h("p", { role: "alert", class: "wrong" }, `This page cannot be shown: ${error instanceof Error ? error.message : error}`),
  );
  throw error;
}
