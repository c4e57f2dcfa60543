/** The bar that runs a simulation: run, pause, step, reset, speed, the clock, and the share that is done. */

import { button, chorded, h } from "./dom.js";
import { clock } from "./numbers.js";

const SPEEDS = [1, 2, 5, 10, 30, 100];
/** What the space key acts on itself while it has the focus. */
const OWN_SPACE = "button, input:not([type='range']), select, summary";
const HALF_A_MINUTE = 35; // s: how long a run lasts at the speed that a page begins with

/** @typedef {"starting" | "ready" | "failed"} Model  whether there is a model to run */

/** The speed that a page begins with.
 * @param {number} duration  s */
export function firstSpeed(duration) {
  return SPEEDS.find((value) => duration / value <= HALF_A_MINUTE) ?? 100;
}

/**
 * @param {any} live
 * @param {{toggle: () => void, step: () => void, reset: () => void, pace: (speed: number | null) => void, back: (time: number) => void, settings: () => void}} acts
 *   speed null: as fast as it goes; back: show a time that has passed; settings: open or close them
 */
export function transport(live, acts) {
  const play = button("Run", acts.toggle, { class: "main", id: "run" });
  const step = button("Step", acts.step, { id: "step", title: `${live.every} samples` });
  const again = button("Reset", acts.reset, { id: "reset" });
  const pace = h(
    "select",
    { id: "speed", "aria-label": "Speed" },
    SPEEDS.map((value) => h("option", { value }, `${value} \u00d7 real time`)),
    h("option", { value: "" }, "as fast as it goes"),
  );
  pace.addEventListener("change", () => acts.pace(pace.value === "" ? null : Number(pace.value)));
  const settings = button("Settings", acts.settings, { id: "open-settings", "aria-controls": "settings", "aria-expanded": "false" });
  const time = h("output", { class: "clock", id: "clock" });
  const badges = live.outages.map((/** @type {any} */ { sensor, name }) => {
    return { sensor, name, since: /** @type {number | null} */ (null), element: h("output", { class: "sensor" }, `${name} on`) };
  });
  const sensors = h("div", { class: "sensors" }, badges.map((/** @type {any} */ one) => one.element));
  const done = h("input", {
    type: "range",
    class: "time",
    id: "time",
    min: 0,
    max: live.duration_s,
    step: live.every / live.rate_hz,
    value: 0,
    "aria-label": "Time shown: drag to go back",
  });
  done.addEventListener("input", () => acts.back(Number(done.value)));
  addEventListener("keydown", (event) => {
    const own = event.target instanceof Element && event.target.closest(OWN_SPACE);
    if (event.key !== " " || own || chorded(event)) return;
    event.preventDefault();
    if (!event.repeat) play.click();
  });
  addEventListener("click", (event) => {
    // a click with the pointer leaves no focus on a button: the space key would press it again
    const pressed = event.detail > 0 && event.target instanceof Element && event.target.closest("button, summary");
    if (pressed instanceof HTMLElement) pressed.blur();
  });
  return {
    element: h("div", { class: "transport", role: "group", "aria-label": "Run" }, play, step, again, settings, pace, time, sensors, done),
    settings,
    /** @param {{model: Model, running: boolean, ended: boolean, speed: number | null}} now */
    show: ({ model, running, ended, speed }) => {
      play.textContent = model === "starting" ? "Starting ..." : running ? "Pause" : ended ? "Run again" : "Run";
      for (const one of [play, again, pace]) one.disabled = model !== "ready";
      step.disabled = model !== "ready" || running || ended;
      pace.value = speed === null ? "" : String(speed);
    },
    /** @param {number} seconds
     * @param {Record<string, number | null>} cuts  by sensor, since when it is cut off, s; null: it is not */
    at: (seconds, cuts) => {
      time.textContent = clock(seconds);
      done.value = String(seconds);
      done.setAttribute("aria-valuetext", clock(seconds));
      for (const one of badges) {
        const since = cuts[one.sensor] ?? null;
        if (since === one.since) continue; // a screen reader tells a change once
        one.since = since;
        one.element.classList.toggle("off", since !== null);
        one.element.textContent = since === null ? `${one.name} on` : `no ${one.name} since ${clock(since)}`;
      }
    },
  };
}
