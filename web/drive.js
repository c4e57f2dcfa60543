/** Driving: the commands of a vehicle by keys, and by dragging on a pad with mouse or finger. */

import { button, chorded, h } from "./dom.js";
import { fixed } from "./numbers.js";

const TICK_MS = 50; // between two commands
const STILL = 3; // px: a pointer that moves less clicks, which commands nothing
const STEPS = 100; // of a deflection: a link of the commands stays short
const RATE = 0.5;
const TURN = { ArrowLeft: -1, ArrowRight: 1, a: -1, d: 1 };
const PUSH = { w: 1, s: -1, ArrowUp: 1, ArrowDown: -1 };

/**
 * @param {any} live  the document; it has commands, or sensors to cut off
 * @param {(values: Record<string, number>) => void} command  by name, SI
 * @param {(sensor: string, on: boolean) => void} cut
 * @param {() => void} undo  drive as the scenario does
 */
export function driver(live, command, cut, undo) {
  /** @type {any[]} */
  const sticks = live.commands?.sticks ?? [];
  const across = sticks.find((stick) => stick.axes.some((/** @type {string} */ axis) => axis === "y" || axis === "r"));
  const along = sticks.find((stick) => stick.axes.includes("z")) ?? sticks.find((stick) => stick !== across);
  const least = along?.one_sided ? 0 : -1; // deflection at the lower edge of the field
  const state = { across: 0, along: /** @type {number | null} */ (null), speed: 0 };
  /** @type {Set<string>} */
  const held = new Set();
  const telling = h("output", { class: "quiet" });
  const knob = h("i", { "aria-hidden": "true" });
  const pad = h(
    "div",
    { class: "pad", tabindex: "0", role: "application", "aria-label": "Drive: arrow keys or W, A, S, D; or drag" },
    knob,
  );

  const value = (/** @type {any} */ stick, /** @type {number} */ deflection) => {
    const part = Math.round(STEPS * deflection) / STEPS;
    const found = (stick.one_sided ? Math.max(0, stick.sign * part) : stick.sign * part) * stick.full_scale * stick.scale;
    return Math.abs(part) < 1 ? Number(found.toPrecision(4)) : found; // the whole may be a bound, which rounding exceeds
  };
  const give = () => {
    /** @type {Record<string, number>} */
    const values = {};
    if (across) values[across.command] = value(across, state.across);
    if (along && state.along !== null) values[along.command] = value(along, state.along);
    command(values);
    place();
  };
  /** The deflection of what is in force before the first command: the speed of a vehicle, or 1 of what multiplies the scenario's own. */
  const inForce = () => {
    if (!along) return 0;
    const now = along.command === "speed" ? state.speed : along.unit === "" ? 1 : 0;
    return Math.min(1, now / (along.full_scale * along.scale));
  };
  const place = () => {
    knob.style.left = `${50 + 50 * state.across}%`;
    knob.style.top = `${(100 * (1 - Math.max(least, state.along ?? inForce()))) / (1 - least)}%`;
    const rates = [along && state.along !== null && said(along, state.along), across && said(across, state.across)];
    telling.textContent = rates.filter(Boolean).join(", ");
  };
  const begin = () => {
    state.along ??= inForce();
  };
  let last = 0;
  const tick = () => {
    const turn = [...held].reduce((sum, key) => sum + (TURN[/** @type {keyof typeof TURN} */ (key)] ?? 0), 0);
    const push = [...held].reduce((sum, key) => sum + (PUSH[/** @type {keyof typeof PUSH} */ (key)] ?? 0), 0);
    const now = performance.now();
    const passed = Math.min(0.2, (now - last) / 1000);
    last = now;
    const before = [state.across, state.along];
    state.across = Math.sign(turn);
    if (push) {
      begin();
      state.along = Math.min(1, Math.max(least, (state.along ?? 0) + Math.sign(push) * RATE * passed));
    }
    if (before[0] !== state.across || before[1] !== state.along) give();
    if (held.size) setTimeout(tick, TICK_MS);
  };
  const named = (/** @type {KeyboardEvent} */ event) => (event.key.length === 1 ? event.key.toLowerCase() : event.key);
  pad.addEventListener("keydown", (/** @type {KeyboardEvent} */ event) => {
    const key = named(event);
    if (!(key in TURN || key in PUSH) || chorded(event)) return;
    event.preventDefault();
    if (event.repeat) return;
    held.add(key);
    last = performance.now() - TICK_MS;
    tick();
  });
  const release = () => {
    const some = held.size > 0;
    held.clear();
    if (some || state.across !== 0) {
      state.across = 0;
      give();
    }
  };
  pad.addEventListener("keyup", (/** @type {KeyboardEvent} */ event) => {
    if (held.delete(named(event)) && !held.size) tick();
  });
  pad.addEventListener("blur", () => held.size && release());
  addEventListener("blur", () => held.size && release());
  /** Where the pointer went down, and whether it has moved since. @type {{x: number, y: number, moved: boolean} | null} */
  let pressed = null;
  let waiting = 0; // until the next command may follow
  let due = false; // whether the pointer has moved since the last one
  const next = () => {
    waiting = 0;
    if (!due) return;
    due = false;
    give();
    waiting = window.setTimeout(next, TICK_MS);
  };
  const drag = (/** @type {PointerEvent} */ event) => {
    if (!pressed) return;
    pressed.moved ||= Math.hypot(event.clientX - pressed.x, event.clientY - pressed.y) >= STILL;
    if (!pressed.moved) return;
    const box = pad.getBoundingClientRect();
    state.across = Math.max(-1, Math.min(1, (2 * (event.clientX - box.left)) / box.width - 1));
    state.along = Math.max(least, Math.min(1, 1 - ((1 - least) * (event.clientY - box.top)) / box.height));
    due = true;
    if (waiting) place();
    else next();
  };
  pad.addEventListener("pointerdown", (/** @type {PointerEvent} */ event) => {
    pad.setPointerCapture(event.pointerId);
    pressed = { x: event.clientX, y: event.clientY, moved: false };
  });
  pad.addEventListener("pointermove", drag);
  for (const name of ["pointerup", "pointercancel"])
    pad.addEventListener(name, () => {
      clearTimeout(waiting);
      waiting = 0;
      pressed = null;
      if (state.across !== 0) release();
      else if (due) give(); // what the pointer said last
      due = false;
    });

  const ways = [
    along && `Up and down: ${along.title.toLowerCase()}.`,
    across && `Left and right: ${across.title.toLowerCase()}.`,
  ]
    .filter(Boolean)
    .join(" ");
  const cuts = live.outages.map((/** @type {any} */ { sensor, name }) => {
    const element = button(`Cut ${name}`, () => cut(sensor, !element.classList.contains("off")), { class: "cut", id: `cut-${sensor}` });
    return { sensor, name, element };
  });
  const back = button("Drive as prepared", undo, { class: "quiet", id: "undrive", hidden: true });
  const element = h(
    "section",
    { class: "drive", "aria-label": "Drive" },
    sticks.length > 0 && h("h2", {}, along?.command === "sea" ? "Sea and wave" : "Drive"),
    sticks.length > 0 && pad,
    sticks.length > 0 &&
      h("p", { class: "quiet" }, `${ways} Drag in the field; or click it, then use the arrow keys or W, A, S, D.`),
    telling,
    h("div", { class: "cuts" }, cuts.map((/** @type {any} */ one) => one.element), back),
  );
  return {
    element,
    /** @param {number} speed  m/s, now
     * @param {Record<string, number | null>} now  since when sensors are cut off, s */
    show: (speed, now) => {
      state.speed = speed;
      if (state.along === null) place();
      for (const { sensor, name, element: one } of cuts) {
        const off = (now[sensor] ?? null) !== null;
        if (one.classList.contains("off") === off) continue;
        one.classList.toggle("off", off);
        one.textContent = off ? `Give ${name} back` : `Cut ${name}`;
      }
    },
    /** @param {boolean} commanded  whether the vehicle has been driven */
    driven: (commanded) => (back.hidden = !commanded),
    release: () => {
      state.along = null;
      state.across = 0;
      held.clear();
      place();
    },
  };
}

/** @param {any} stick
 * @param {number} deflection */
function said(stick, deflection) {
  return `${stick.title.toLowerCase()} ${fixed((stick.one_sided ? Math.max(0, deflection) : deflection) * stick.full_scale, 1)} ${stick.unit}`;
}
