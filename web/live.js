/** The live page: a scenario and its estimators run in a worker; this module joins the parts of the page. */

import { addressOf, stateOf } from "./address.js";
import { cloudPanel } from "./cloud.js";
import { controlPanel } from "./controls.js";
import { headingDial } from "./dial.js";
import { button, fill, h } from "./dom.js";
import { driver } from "./drive.js";
import { makeHistory } from "./history.js";
import { hullView } from "./hull.js";
import { legend, othersOf } from "./legend.js";
import { livePanels } from "./livepanels.js";
import { changed, copy, cutNow, download, notesOf, outagesOf, same } from "./livestate.js";
import { clock } from "./numbers.js";
import { endTables, readings } from "./readings.js";
import { startSession } from "./session.js";
import { makeSpan, spanControls } from "./span.js";
import { onTheme, themeButton } from "./theme.js";
import { makeTrack } from "./livetrack.js";

const SPEEDS = [1, 2, 5, 10, 30, 100];
const SHORTEST = 10;
const HALF_A_MINUTE = 35; // s: how long a run lasts at the speed that a page begins with
const ADDRESS_MS = 250;

/**
 * @param {any} live  the document
 * @returns {HTMLElement}
 */
export function livePage(live) {
  const rows = new Map(live.tables.outputs.map((/** @type {any} */ row) => [row.name, row]));
  const at = (/** @type {string} */ name) => /** @type {any} */ (rows.get(name));
  const session = startSession();
  const history = makeHistory(live.sizes.y, Math.ceil(live.samples / live.every) + 2);
  const span = makeSpan(0, SHORTEST);
  const panels = livePanels(live, span);
  const hull = hullView(live.vehicle);
  const dial = headingDial();
  const numbers = readings(live, at);
  const track = makeTrack(live, at);
  const end = h("section", { class: "end", "aria-live": "polite", hidden: true });
  const wrong = h("p", { class: "wrong told", role: "alert", id: "wrong" });
  /** @type {{seed: number, values: Record<string, any>, commands: any}} */
  let state = { seed: live.seed, values: {}, commands: undefined };
  let clouding = false;
  let settings = state.values;
  let [running, ended, speed] = [
    false,
    false,
    /** @type {number | null} */ (SPEEDS.find((value) => live.duration_s / value <= HALF_A_MINUTE) ?? 100),
  ];
  /** @type {any} */
  let frame = null;
  let drawn = { due: false, shown: 0 };

  // --- what is asked of the simulation

  const run = () => {
    if (clouding) {
      session.send({ do: "cloud", units: 0 });
      cloud.stop();
      clouding = false;
    }
    if (ended) restart(false);
    session.send({ do: "run", speed });
    running = true;
    show();
  };
  const pause = () => {
    session.send({ do: "pause" });
    running = false;
    show();
  };
  const restart = (/** @type {boolean} */ go) => {
    session.send({ do: "reset", ...state });
    running = ended = false;
    if (go) run();
    show();
  };
  const change = (/** @type {number | null} */ seed, /** @type {Record<string, any>} */ values) => {
    const go = running;
    state = { seed: seed ?? state.seed, values: changed(live, state.values, values), commands: state.commands };
    wrong.textContent = "";
    restart(go);
  };
  const controls = controlPanel(live, change, () => {
    state = { seed: live.seed, values: {}, commands: undefined };
    wrong.textContent = "";
    restart(running);
  });
  const drive = driver(
    live,
    (values) => {
      if (ended) {
        wrong.textContent = "The run has ended: press Reset to drive again.";
        return;
      }
      if (speed === null || speed > 2) speed = 1;
      session.send({ do: "input", values });
      session.send({ do: "values" });
      if (!running || speed === 1) run();
    },
    (sensor, on) => session.send({ do: "cut", sensor, on }),
  );
  const cloud = cloudPanel(live, () => {
    running = false;
    clouding = true;
    cloud.begin();
    session.send({ do: "cloud", units: 64 });
    show();
  });

  // --- what comes back

  const take = (/** @type {any} */ message) => {
    frame = message;
    if (message.records.length) {
      const before = history.count();
      history.add(message.records);
      panels.take(history, before, history.count());
      track.take(history, before, history.count());
      span.extend(0, Math.max(SHORTEST, message.time_s));
    }
    drawn.due = true;
  };
  session.on("ready", () => {
    if (!location.hash) return;
    try {
      state = stateOf(location.hash, live);
      restart(false);
    } catch (error) {
      wrong.textContent = `This link cannot be followed: ${error instanceof Error ? error.message : error}. The scenario is shown as it is.`;
    }
  });
  session.on("reset", (message) => {
    history.clear();
    panels.clear();
    track.clear();
    hull.reset();
    span.extend(0, SHORTEST);
    span.reset();
    end.hidden = true;
    clouding = false;
    cloud.stop();
    if (!same(settings, state.values)) cloud.clear(); // it was of other settings
    settings = state.values;
    panels.shade(outagesOf(live, state.values));
    drive.release();
    const own = Object.keys(state.values).length === 0 && same(state.commands ?? live.commands?.given, live.commands?.given);
    panels.limited(own);
    cloud.limited(own);
    controls.show(message.seed, state.values);
    take(message);
    session.send({ do: "values" });
    show();
  });
  session.on("frame", take);
  session.on("end", (message) => {
    take(message);
    running = false;
    ended = true;
    fill(
      end,
      h("h2", {}, "At the end, as ", h("code", {}, "insenv run"), " prints it"),
      h("div", { class: "tables several" }, endTables(live, at, history)),
    );
    end.hidden = false;
    show();
  });
  session.on("cloud", (message) => {
    cloud.take(message);
    clouding = message.done < message.units;
  });
  session.on("values", (message) => {
    state = { seed: message.seed, values: message.values, commands: message.commands };
    keep();
    panels.shade(outagesOf(live, state.values));
    if (Object.keys(state.values).length || !same(state.commands, live.commands?.given)) {
      panels.limited(false);
      cloud.limited(false);
    }
  });
  session.on("toml", ({ name, text }) => download(name, text));
  session.on("error", ({ message }) => {
    running = clouding = false;
    cloud.stop();
    wrong.textContent = message;
    show();
  });

  let keeping = false;
  const keep = () => {
    if (keeping) return; // a browser takes only some addresses a minute
    keeping = true;
    setTimeout(() => {
      keeping = false;
      const fragment = addressOf(
        { ...state, commands: same(state.commands, live.commands?.given) ? undefined : state.commands },
        live.seed,
      );
      try {
        window.history.replaceState(null, "", fragment ? `#${fragment}` : location.pathname + location.search);
      } catch {
        // an address may not be set in some frames: the link is then not kept
      }
    }, ADDRESS_MS);
  };

  // --- what is seen

  const play = button("Run", () => (running ? pause() : run()), { class: "main", id: "run" });
  const step = button("Step", () => session.send({ do: "step", samples: live.every }), {
    id: "step",
    title: `${live.every} samples`,
  });
  const again = button("Reset", () => restart(false), { id: "reset" });
  const pace = h(
    "select",
    { id: "speed", "aria-label": "Speed" },
    SPEEDS.map((value) => h("option", { value }, `${value} \u00d7 real time`)),
    h("option", { value: "" }, "as fast as it goes"),
  );
  pace.addEventListener("change", () => {
    speed = pace.value === "" ? null : Number(pace.value);
    if (running) run();
  });
  const time = h("output", { class: "clock", id: "clock" });
  const done = h("progress", { max: live.duration_s, value: 0, "aria-label": "Share of the run" });
  const show = () => {
    play.textContent = running ? "Pause" : ended ? "Run again" : "Run";
    step.disabled = running || ended;
    pace.value = speed === null ? "" : String(speed);
  };
  addEventListener("keydown", (event) => {
    const inside =
      event.target instanceof HTMLElement && event.target.closest("button, input, select, summary, [role='application']");
    if (event.key === " " && !inside) {
      event.preventDefault();
      play.click();
    }
  });
  const tables = { truth: at("q_nb").at, attitude: at("attitude").at };
  const estimates = live.estimators.map((/** @type {any} */ one, /** @type {number} */ group) => ({
    group,
    q: at(`${one.prefix}q_nb`).at,
    attitude: at(`${one.prefix}attitude`).at,
    sigma: one.stated.indexOf("heading_deg") < 0 ? null : at(`${one.prefix}sigma`).at + one.stated.indexOf("heading_deg"),
  }));
  /** @type {Set<number>} */
  const hidden = new Set();
  const paint = () => {
    requestAnimationFrame(paint);
    if (frame) {
      const y = frame.outputs;
      const shown = estimates.filter((/** @type {any} */ one) => !hidden.has(one.group));
      hull.draw(
        y.subarray(tables.truth, tables.truth + 4),
        shown.map((/** @type {any} */ one) => ({ group: one.group, q: y.subarray(one.q, one.q + 4) })),
        y[tables.attitude + 2],
      );
      if (drawn.due) {
        drawn.due = false;
        dial.draw(
          y[tables.attitude + 2],
          shown.map((/** @type {any} */ one) => ({
            group: one.group,
            heading: y[one.attitude + 2],
            sigma: one.sigma === null ? null : y[one.sigma],
          })),
        );
        time.textContent = clock(frame.time_s);
        done.value = frame.time_s;
        const now = performance.now();
        if (!running || now - drawn.shown > 100) {
          drawn.shown = now;
          numbers.draw(y);
          track.draw();
        } else drawn.due = true;
        drive.show(Math.hypot(y[at("velocity_n").at], y[at("velocity_n").at + 1]), cutNow(live, state.values, frame.time_s));
      }
    }
    panels.draw();
  };
  onTheme(() => (drawn.due = true));
  requestAnimationFrame(paint);
  session.send({ do: "load", live });
  show();

  const hide = (/** @type {number} */ group, /** @type {boolean} */ shown) => {
    if (shown) hidden.delete(group);
    else hidden.add(group);
    panels.show(group, shown);
    track.show(group, shown);
    drawn.due = true;
  };
  const steered = live.commands || live.outages.length > 0;
  const link = button("Copy link", () => copy(link), { class: "quiet" });
  const toml = button("Download as scenario", () => session.send({ do: "toml" }), { class: "quiet", id: "toml" });
  return h(
    "div",
    { class: "frame live" },
    h(
      "header",
      {},
      h(
        "div",
        {},
        h("h1", {}, live.title || live.name),
        h(
          "p",
          { class: "facts" },
          `${live.name} \u00b7 ${live.duration_s} s at ${live.rate_hz} Hz \u00b7 ${live.estimators.map((/** @type {any} */ one) => one.id).join(", ")}`,
        ),
      ),
      h("div", { class: "tools" }, link, toml, themeButton()),
    ),
    h(
      "main",
      {},
      h("div", { class: "transport", role: "group", "aria-label": "Run" }, play, step, again, pace, time, done),
      wrong,
      h(
        "div",
        { class: "stage" },
        h("h2", { class: "hidden" }, "The vehicle now"),
        h("div", { class: "views" }, hull.element, dial.element, track.element),
        h("div", { class: "side" }, steered && drive.element, numbers.element),
      ),
      notesOf(live),
      end,
      h(
        "div",
        { class: "columns" },
        controls.element,
        h(
          "div",
          { class: "plots" },
          h(
            "div",
            { class: "bar" },
            legend(
              live.estimators.map((/** @type {any} */ one) => ({ name: one.id })),
              othersOf(panels.panels, "truth"),
              hide,
            ),
            spanControls(span),
          ),
          panels.elements,
          cloud.element,
        ),
      ),
    ),
    h(
      "footer",
      {},
      "The equations of insenv as WebAssembly: the numbers are those of ",
      h("code", {}, "insenv run"),
      ", to the bit. The space key runs and pauses. This page makes no request.",
    ),
  );
}
