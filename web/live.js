/** The live page: a scenario and its estimators run in a worker; this module joins the parts of the page. */

import { addressOf, stateOf } from "./address.js";
import { cloudPanel } from "./cloud.js";
import { controlPanel } from "./controls.js";
import { button, h } from "./dom.js";
import { driver } from "./drive.js";
import { showEnd } from "./ending.js";
import { lastRun } from "./ghost.js";
import { makeHistory } from "./history.js";
import { loadRules } from "./judge.js";
import { legend, othersOf } from "./legend.js";
import { livePanels } from "./livepanels.js";
import { changed, changesOf, conditions, copy, cutNow, download, notesOf, outagesOf, preparedState, shared } from "./livestate.js";
import { notesPanel } from "./notes.js";
import { heading, origin } from "./origin.js";
import { startSession } from "./session.js";
import { makeSpan, spanControls } from "./span.js";
import { storyStrip } from "./story.js";
import { onTheme } from "./theme.js";
import { firstSpeed, transport } from "./transport.js";
import { vehicleViews } from "./views.js";

const SHORTEST = 10;
const ADDRESS_MS = 250;

/**
 * @param {any} live  the document
 * @returns {HTMLElement}
 */
export function livePage(live) {
  const rows = new Map(live.tables.outputs.map((/** @type {any} */ row) => [row.name, row]));
  const at = (/** @type {string} */ name) => /** @type {any} */ (rows.get(name));
  const session = startSession();
  const history = makeHistory(at, live.sizes.y, Math.ceil(live.samples / live.every) + 2);
  const span = makeSpan(0, SHORTEST);
  const panels = livePanels(live, at, span);
  const views = vehicleViews(live, at, history);
  const ghost = lastRun(live, (run) => {
    panels.beside(run?.history ?? null);
    views.beside(run?.history ?? null);
    lengthen();
  });
  const notes = notesPanel(live);
  const story = storyStrip(live.values.story ?? []);
  const end = h("section", { class: "end", "aria-live": "polite", hidden: true });
  const wrong = h("p", { class: "wrong message", role: "alert", id: "wrong" });
  let state = preparedState(live);
  let clouded = conditions(live, state);
  let due = false; // whether the settings are to be shown again
  let linked = false; // whether the state is that of a link which has not started yet
  let model = /** @type {import("./transport.js").Model} */ ("starting");
  let [running, ended, clouding] = [false, false, false];
  let speed = /** @type {number | null} */ (firstSpeed(live.duration_s));
  /** @type {any} */
  let frame = null;
  let back = /** @type {number | null} */ (null); // the record that a reader has gone back to
  let ran = state; // that of the records
  /** @type {import("./ghost.js").LastRun | null} */
  let retired = null;

  // --- what is asked of the simulation

  const run = () => {
    if (clouding) {
      session.send({ do: "cloud", units: 0 });
      cloud.stop();
      clouding = false;
    }
    if (ended) restart(false);
    showTime(null);
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
  const begin = (/** @type {import("./address.js").State} */ now) => {
    state = now;
    wrong.textContent = "";
    restart(running);
  };
  const bar = transport(live, {
    toggle: () => (running ? pause() : run()),
    step: () => {
      showTime(null);
      session.send({ do: "step", samples: live.every });
    },
    reset: () => restart(false),
    pace: (value) => {
      speed = value;
      if (running) run();
    },
    settings: () => openSettings(controls.element.hidden === true),
    back: (time) => {
      if (running) pause();
      const last = history.count() - 1;
      const place = Math.round((time * live.rate_hz) / live.every) - 1;
      if (last >= 0) showTime(place < last ? Math.max(0, place) : null);
    },
  });
  /** Show a record, or null: what is now. */
  const showTime = (/** @type {number | null} */ record) => {
    back = record;
    panels.point(record === null ? null : history.value(at("time").at, record));
    views.ask();
  };
  const show = () => bar.show({ model, running, ended, speed });
  const controls = controlPanel(
    live,
    (seed, values) => begin({ ...state, seed: seed ?? state.seed, values: changed(live, state.values, values) }),
    () => begin(preparedState(live)),
    () => openSettings(false),
  );
  const openSettings = (/** @type {boolean} */ open) => {
    controls.element.hidden = !open;
    bar.settings.setAttribute("aria-expanded", String(open));
    if (open) controls.element.querySelector("input")?.focus();
    else bar.settings.focus();
  };
  controls.element.addEventListener("keydown", (/** @type {KeyboardEvent} */ event) => event.key === "Escape" && openSettings(false));
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
    () => begin({ ...state, commands: undefined }),
  );
  const cloud = cloudPanel(live, (units) => {
    running = false;
    clouding = true;
    cloud.begin();
    session.send({ do: "cloud", units });
    show();
  });

  // --- what comes back

  const take = (/** @type {any} */ message) => {
    frame = message;
    if (message.records.length) {
      const before = history.count();
      history.add(message.records);
      panels.take(history, before, history.count());
      views.take(before, history.count());
      lengthen();
    }
    views.ask();
  };
  /** Show the time of this run and of the last one. */
  const lengthen = () => {
    const ends = [history, ghost.run()?.history].map((one) => (one?.count() ? one.value(at("time").at, one.count() - 1) : 0));
    span.extend(0, Math.max(SHORTEST, ...ends));
  };
  /** Say what of the scenario has changed, and show the limit where it holds. */
  const compare = () => {
    const changes = changesOf(live, state);
    const prepared = !changes.settings && !changes.commands;
    drive.driven(changes.commands);
    panels.limited(prepared);
    cloud.limited(prepared);
    notes.show(changes, changes.commands ? null : notesOf(live, state));
    panels.shade(outagesOf(live, state.values));
    const now = conditions(live, state);
    if (now !== clouded) cloud.clear(); // it was of other settings or commands
    clouded = now;
    return changes;
  };
  const refuse = (/** @type {unknown} */ error) => {
    wrong.textContent = `This link cannot be followed: ${error instanceof Error ? error.message : error}. The scenario is shown as it is.`;
  };
  const starts = location.hash === "#run"; // of a page that stands in another one and was asked for there
  const followed = location.hash && !starts ? stateOf(location.hash, live) : null;
  session.on("ready", () => {
    followed?.then((now) => {
      state = now;
      linked = true;
      restart(false);
    }, refuse);
  });
  session.on("reset", (message) => {
    retired = { state: ran, history: history.retire() };
    panels.clear();
    views.clear();
    showTime(null);
    lengthen();
    span.reset();
    end.hidden = true;
    clouding = false;
    cloud.stop();
    drive.release();
    compare();
    take(message);
    due = true;
    session.send({ do: "values" });
    show();
  });
  session.on("frame", take);
  session.on("end", (message) => {
    take(message);
    running = false;
    ended = true;
    const last = ghost.run();
    const whole = last && last.history.count() === history.count();
    showEnd(end, live, history, compare(), whole ? { history: last.history, told: ghost.told() } : null);
    show();
  });
  session.on("cloud", (message) => {
    cloud.take(message);
    clouding = message.done < message.units;
  });
  session.on("values", (message) => {
    state = { seed: message.seed, values: message.values, commands: message.commands };
    ran = state;
    if (retired) ghost.begin(retired, state);
    retired = null;
    linked = false;
    if (model !== "ready") {
      become("ready");
      if (starts) run();
    }
    if (due) controls.show(state.seed, state.values); // not with each command: a reader may be typing
    due = false;
    keep();
    compare();
  });
  session.on("toml", ({ name, text }) => download(name, text));
  session.on("error", ({ message }) => {
    running = clouding = false;
    cloud.stop();
    if (linked) refuse(message);
    else wrong.textContent = message;
    if (model === "starting" && !linked) become("failed");
    show();
  });

  let keeping = false;
  const keep = () => {
    if (keeping) return; // a browser takes only some addresses a minute
    keeping = true;
    setTimeout(async () => {
      keeping = false;
      const fragment = await addressOf({ ...state, commands: changesOf(live, state).commands ? state.commands : undefined }, live.seed);
      try {
        window.history.replaceState(null, "", fragment ? `#${fragment}` : location.pathname + location.search);
      } catch {
        // an address may not be set in some frames: the link is then not kept
      }
    }, ADDRESS_MS);
  };

  // --- what is seen

  const paint = () => {
    if (model === "ready" && frame) {
      const [y, until] = back === null ? [frame.outputs, history] : [history.row(back), history.first(back + 1)];
      const time = back === null ? frame.time_s : y[at("time").at];
      const cuts = cutNow(live, state.values, time);
      if (views.draw(y, running, until, (cuts.gnss ?? null) !== null)) {
        const velocity = at("velocity_n").at;
        bar.at(time, cuts);
        story.at(time, outagesOf(live, state.values));
        drive.show(Math.hypot(y[velocity], y[velocity + 1]), cuts);
      }
    }
    panels.draw(running);
  };
  const next = () => {
    requestAnimationFrame(next);
    paint();
  };
  requestAnimationFrame(next);
  onTheme(() => {
    views.ask();
    paint(); // at once: for paper there is no further frame
  });
  controls.show(state.seed, state.values);
  Promise.allSettled([loadRules(live.rules), followed]).then(() => session.send({ do: "load", live }));

  const hide = (/** @type {number} */ group, /** @type {boolean} */ shown) => {
    panels.show(group, shown);
    views.show(group, shown);
  };
  const steered = live.commands || live.outages.length > 0;
  const others = othersOf(panels.panels, "truth");
  if (live.outages.some((/** @type {any} */ one) => one.sensor === "gnss") && !others.some((one) => one.kind === "outage"))
    others.push({ kind: "outage", text: "no GNSS" });
  if (views.fixes) others.push({ kind: "fix", text: "fix of GNSS" });
  const names = live.estimators.map((/** @type {any} */ one) => ({ name: one.id }));
  const keys = h("div", { class: "bar" }, legend(names, others, hide), ghost.element, spanControls(span));
  const main = h(
    "main",
    {},
    bar.element,
    wrong,
    story.element,
    h(
      "div",
      { class: `stage${steered ? " steered" : ""}` },
      h("h2", { class: "hidden" }, "The vehicle now"),
      views.views,
      steered && drive.element,
    ),
    end,
    keys,
    h(
      "div",
      { class: "columns" },
      h("div", { class: "aside" }, views.numbers, notes.element),
      h("div", { class: "plots" }, panels.elements, cloud.element),
    ),
    controls.element,
  );
  if (panels.heading) besideVehicle(panels.heading, views.views);
  /** What acts on the model is there with it. */
  const become = (/** @type {import("./transport.js").Model} */ now) => {
    model = now;
    main.setAttribute("aria-busy", String(model === "starting"));
    for (const part of [controls, drive, cloud]) part.element.inert = model !== "ready";
    show();
  };
  become("starting");
  return h(
    "div",
    { class: "frame live" },
    head(live, () => session.send({ do: "toml" })),
    main,
    h(
      "footer",
      {},
      "The equations of insenv as WebAssembly: the numbers are those of ",
      h("code", {}, "insenv run"),
      ", to the bit. The space key runs and pauses, unless a button, a list or a field has the focus of the keyboard. This page makes no request.",
      origin(live.version),
      h(
        "p",
        {},
        h("code", {}, "insenv run FILE.toml"),
        " runs the downloaded scenario. The estimators: ",
        live.estimators.map((/** @type {any} */ { id, title }) => `${id}, ${title}`).join("; "),
        ".",
      ),
    ),
  );
}

/** On a phone a plot stands in the first screen, beside the vehicle.
 * @param {HTMLElement} plot
 * @param {HTMLElement} views */
function besideVehicle(plot, views) {
  const [home, next] = [/** @type {HTMLElement} */ (plot.parentElement), plot.nextSibling];
  const phone = matchMedia("(max-width: 640px)");
  const place = () => (phone.matches ? views.append(plot) : home.insertBefore(plot, next));
  phone.addEventListener("change", place);
  place();
}

/** The head of the page.
 * @param {any} live
 * @param {() => void} toml  ask for the scenario file */
function head(live, toml) {
  // from a file the address leads nobody else here: its scenario does
  const link = shared() && button("Copy link", () => copy(link), { class: "quiet" });
  const ids = live.estimators.map((/** @type {any} */ one) => one.id).join(", ");
  const facts = [live.name, `${live.duration_s} s at ${live.rate_hz} Hz`, ids];
  return heading(live.title || live.name, "", facts, [link, button("Download as scenario", toml, { class: "quiet", id: "toml" })]);
}
