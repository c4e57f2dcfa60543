/** The end of a live run: the tables that `insenv run` prints. */

import { fill, h } from "./dom.js";
import { healthNow, notesAtEnd, statisticsOf, steepPitch } from "./judge.js";
import { number, significant } from "./numbers.js";
import { summaryTable } from "./tables.js";

const LAST = "last run";

/** Fill the section at the end of a run.
 * @param {HTMLElement} section
 * @param {any} live
 * @param {import("./history.js").Recorded} history
 * @param {{settings: boolean, commands: boolean}} changes  of the scenario as it stands: its limit is known, and all its notes
 * @param {{history: import("./history.js").Recorded, told: string} | null} last  the last run, if it ended */
export function showEnd(section, live, history, changes, last) {
  const tables = live.estimators.map((/** @type {any} */ one) => endTable(live, one, history, changes, last?.history ?? null));
  const columns = new Set(tables.flatMap((/** @type {any} */ one) => one.columns));
  const meanings = ["rms", "limit", "stated"].filter((name) => columns.has(name)).map((name) => live.explained[name]);
  if (live.estimators.some((/** @type {any} */ one) => one.channels.includes("vn_mps"))) meanings.push(live.explained.vn);
  if (columns.has("limit")) meanings.push(live.explained.within);
  if (last) meanings.push(`${LAST}: rms with ${last.told}.`);
  fill(
    section,
    h("h2", {}, "At the end, with the figures of ", h("code", {}, "insenv run")),
    h("div", { class: "tables several" }, tables.map(summaryTable)),
    h("p", { class: "quiet" }, meanings.join(" ")),
  );
  section.hidden = false;
}

/** The document of the table of an estimator (web/README.md).
 * @param {any} live
 * @param {any} estimator
 * @param {import("./history.js").Recorded} history
 * @param {{settings: boolean, commands: boolean}} changes
 * @param {import("./history.js").Recorded | null} last */
function endTable(live, estimator, history, changes, last) {
  const { settled } = estimator;
  const statistics = statisticsOf(estimator, history);
  const prepared = !changes.settings && !changes.commands;
  const limit = prepared ? estimator.limit : {};
  /** @type {string[]} */
  const columns = [...estimator.columns[prepared ? "prepared" : "changed"]];
  if (last) columns.splice(columns.indexOf("rms") + 1, 0, LAST);
  const before = last && statisticsOf(estimator, last);
  const [ratio] = columns.filter((name) => name.startsWith("rms/"));
  const yardstick = ratio?.slice("rms/".length);
  const left = steepPitch(live, estimator, history).channels;
  const rows = statistics.map((one, place) => {
    const judged = !left.includes(one.channel);
    const kinds = { ...one, limit: judged ? (limit[one.channel] ?? null) : null, [LAST]: before?.[place].rms };
    const cells = columns.slice(1).filter((name) => name !== ratio).map((kind) => /** @type {any} */ (kinds)[kind]);
    const own = yardstick && /** @type {any} */ (kinds)[yardstick];
    const known = own && settled && judged && !(yardstick === "limit" && own < live.limit.floor[one.channel]);
    return { channel: one.channel, cells: [...cells, ...(ratio ? [known ? one.rms / own : null] : [])] };
  });
  const health = healthNow(live, estimator, history);
  const below = estimator.from_s > 0 ? [`Statistics from ${significant(estimator.from_s, 6)} s on`] : [];
  if (health) below.push(`Health: ${health.lines[0]}`, ...health.lines.slice(1));
  below.push(...notesAtEnd(live, estimator, history, !changes.settings));
  return {
    caption: estimator.id,
    columns,
    rows: rows.map(({ channel, cells }) => [live.channels[channel].label, ...cells.map(number)]),
    group: estimator.group,
    below,
    warnings: rows.flatMap(({ cells }, place) => (ratio && (cells[cells.length - 1] ?? 0) > live.marked ? [[place, cells.length]] : [])),
    state: health?.verdict ?? "",
  };
}
