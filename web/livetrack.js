/** The track of a live page: the truth, the estimates that navigate, fixes used and refused. */

import { trackPlot } from "./track.js";

const EARTH = 6371000; // m: shows a fix beside the vehicle, where a per mille of their distance is not seen
const FARTHEST = 1000; // m: a fix farther away is none yet

/**
 * @param {any} live
 * @param {(name: string) => any} at  a row of the outputs
 */
export function makeTrack(live, at) {
  const navigators = live.estimators
    .map((/** @type {any} */ one) => {
      const sigma = ["east_m", "north_m"].map((name) => one.stated.indexOf(name)).filter((place) => place >= 0);
      return { group: one.group, row: at(`${one.prefix}offset_n`), sigma: sigma.map((place) => at(`${one.prefix}sigma`).at + place) };
    })
    .filter((/** @type {any} */ one) => one.row);
  const sources = [{ group: -1, row: at("offset_n") }, ...navigators];
  const lines = sources.map(({ group }) => ({
    group,
    east: /** @type {number[]} */ ([]),
    north: /** @type {number[]} */ ([]),
  }));
  const filter = live.estimators
    .map((/** @type {any} */ one) => ({
      group: one.group,
      count: at(`${one.prefix}fix_count`),
      refused: at(`${one.prefix}fix_refused_count`),
    }))
    .find((/** @type {any} */ one) => one.count);
  /** @type {any} */
  const scene = { lines, last: [], ellipses: [], refused: [], accepted: [], places: [0, 0] };
  const label = "Seen from above: the truth and the estimates with three sigmas; crosses are refused fixes.";
  const plot = trackPlot("Track", scene, label, true);
  const mark = (/** @type {any} */ history, /** @type {number} */ place) => {
    if (!filter || place === 0 || !at("gnss_latitude")) return;
    const grown = (/** @type {any} */ row) => history.value(row.at, place) > history.value(row.at, place - 1);
    if (!grown(filter.count)) return;
    const [latitude, longitude] = [history.value(at("latitude").at, place), history.value(at("longitude").at, place)];
    const north = EARTH * (history.value(at("gnss_latitude").at, place) - latitude);
    const east = EARTH * Math.cos(latitude) * (history.value(at("gnss_longitude").at, place) - longitude);
    if (!(Math.hypot(north, east) < FARTHEST)) return;
    const fix = { group: filter.group, place, north: lines[0].north[place] + north, east: lines[0].east[place] + east };
    (grown(filter.refused) ? scene.refused : scene.accepted).push(fix);
  };
  return {
    element: plot.element,
    fixes: Boolean(filter && at("gnss_latitude")),
    show: plot.show,
    take: (/** @type {any} */ history, /** @type {number} */ first, /** @type {number} */ after) => {
      for (let place = first; place < after; place++) {
        sources.forEach(({ row }, k) => {
          lines[k].north.push(history.value(row.at, place));
          lines[k].east.push(history.value(row.at + 1, place));
        });
        mark(history, place);
      }
    },
    /** Show the last run too. @param {import("./history.js").Recorded | null} history */
    beside: (history) => {
      const column = (/** @type {number} */ at) =>
        history ? Array.from({ length: history.count() }, (_, place) => history.value(at, place)) : [];
      scene.last = navigators.map((/** @type {any} */ { group, row }) => ({ group, north: column(row.at), east: column(row.at + 1) }));
      plot.draw();
    },
    clear: () => {
      for (const line of lines) line.north.length = line.east.length = 0;
      scene.refused.length = scene.accepted.length = 0;
      scene.places = [0, 0];
    },
    /** @param {number} count  records to show
     * @param {Float64Array} y  outputs
     * @param {boolean} cut  whether there is no GNSS */
    draw: (count, y, cut) => {
      scene.places = [0, count];
      scene.cut = cut;
      scene.ellipses = navigators
        .filter((/** @type {any} */ one) => one.sigma.length === 2)
        .map((/** @type {any} */ { group, row, sigma: [east, north] }) => ({
          group,
          centre: [y[row.at + 1], y[row.at]],
          radii: [3 * y[east], 3 * y[north]],
        }));
      plot.draw();
    },
  };
}
