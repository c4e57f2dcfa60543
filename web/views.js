/** The vehicle now: hull, heading dial, track and numbers, from the latest outputs of the simulation. */

import { headingDial } from "./dial.js";
import { h } from "./dom.js";
import { hullView } from "./hull.js";
import { makeTrack } from "./livetrack.js";
import { readings } from "./readings.js";

const SLOW_MS = 100; // between two times that numbers and track are drawn while it runs

/**
 * @param {any} live
 * @param {(name: string) => any} at
 * @param {import("./history.js").Recorded} history
 */
export function vehicleViews(live, at, history) {
  const hull = hullView(live.shape);
  const dial = headingDial();
  const numbers = readings(live, at);
  const track = makeTrack(live, at);
  const truth = { q: at("q_nb").at, attitude: at("attitude").at };
  const estimates = live.estimators.map((/** @type {any} */ one) => ({
    group: one.group,
    q: at(`${one.prefix}q_nb`).at,
    attitude: at(`${one.prefix}attitude`).at,
    sigma: one.stated.indexOf("heading_deg") < 0 ? null : at(`${one.prefix}sigma`).at + one.stated.indexOf("heading_deg"),
  }));
  /** @type {Set<number>} */
  const hidden = new Set();
  let [due, drawn] = [false, 0];
  return {
    views: h("div", { class: "views" }, hull.element, dial.element, track.element),
    numbers: numbers.element,
    fixes: track.fixes,
    /** Records from one place to before another are new.
     * @param {number} first
     * @param {number} after */
    take: (first, after) => track.take(history, first, after),
    beside: track.beside,
    /** Draw again with the next frame. */
    ask: () => (due = true),
    clear: () => {
      track.clear();
      hull.reset();
    },
    /** @param {number} group
     * @param {boolean} shown */
    show: (group, shown) => {
      if (shown) hidden.delete(group);
      else hidden.add(group);
      track.show(group, shown);
      due = true;
    },
    /** Draw a frame; true if anything is new.
     * @param {Float64Array} y  outputs
     * @param {boolean} running
     * @param {import("./history.js").Recorded} until  the records up to then
     * @param {boolean} cut  whether there is no GNSS
     * @returns {boolean} */
    draw: (y, running, until, cut) => {
      const shown = estimates.filter((/** @type {any} */ one) => !hidden.has(one.group));
      hull.draw(
        y.subarray(truth.q, truth.q + 4),
        shown.map((/** @type {any} */ one) => ({ group: one.group, q: y.subarray(one.q, one.q + 4) })),
        y[truth.attitude + 2],
      );
      if (!due) return false;
      due = false;
      dial.draw(
        y[truth.attitude + 2],
        shown.map((/** @type {any} */ one) => ({
          group: one.group,
          heading: y[one.attitude + 2],
          sigma: one.sigma === null ? null : y[one.sigma],
        })),
      );
      const now = performance.now();
      if (!running || now - drawn > SLOW_MS) {
        drawn = now;
        numbers.draw(y, until);
        track.draw(until.count(), y, cut);
      } else due = true;
      return true;
    },
  };
}
