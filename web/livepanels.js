/** The plots of a live page: errors with sigma and limit, biases, test ratios; they grow with the records. */

import { sectionOf } from "./dom.js";
import { between } from "./history.js";
import { roundUp } from "./numbers.js";
import { timePlot } from "./timeplot.js";

const AT_ONCE = 2;

/** Up to which error the scale of a channel is linear: about what an optimal estimator ends with, two of the limits of the last
 * quarter; null without a limit.
 * @param {any} live
 * @param {string} channel */
export function thresholdOf(live, channel) {
  const limit = live.limit?.sigma[channel];
  if (!limit) return null;
  const settled = Math.max(...limit.slice(Math.floor((3 * limit.length) / 4)));
  return settled > 0 ? roundUp(2 * settled) : null;
}

/**
 * @param {any} live
 * @param {(name: string) => any} at  a row of the outputs
 * @param {import("./span.js").Span} span
 */
export function livePanels(live, at, span) {
  const ids = live.estimators.map((/** @type {any} */ one) => one.id);
  /** @type {number[]} */
  const x = [];
  /** @type {number[]} */
  let longer = []; // times of the last run
  /** @type {{panel: any, feeds: Read[], last: {curve: any, read: any}[], plot: any, due: boolean, seen: boolean}[]} */
  const panels = [];
  let limited = true;

  const add = (/** @type {string} */ title, /** @type {string} */ unit, /** @type {any} */ more) => {
    const panel = { title, unit, shade: /** @type {[number, number][]} */ ([]), x, curves: /** @type {any[]} */ ([]), ...more };
    const made = { panel, feeds: /** @type {any[]} */ ([]), last: /** @type {any[]} */ ([]), plot: null, due: false, seen: false };
    panels.push(made);
    return made;
  };
  const kit = { live, at, add };
  const channels = [...new Set(live.estimators.flatMap((/** @type {any} */ one) => one.channels))];
  const groups = [
    channels.filter((c) => c.endsWith("_deg")),
    channels.filter((c) => c.endsWith("_m")),
    channels.filter((c) => c.endsWith("_mps")),
  ];
  const sections = groups
    .filter((group) => group.length)
    .map((group, place) => ({
      title: ["Attitude error", "Position error", "Velocity error"][place],
      columns: 3,
      panels: group.map((channel) => errorPanel(kit, channel, () => limited)),
    }));
  const { rows, axes } = live.biases;
  const biases = rows
    .flatMap((/** @type {any[]} */ [title, row, unit, factor]) =>
      axes.map((/** @type {string} */ axis, /** @type {number} */ k) =>
        biasPanel(kit, row, `${title}, ${axis}`, unit, factor, k),
      ),
    )
    .filter(Boolean);
  if (biases.length) sections.push({ title: "Estimated biases", columns: 3, panels: /** @type {any[]} */ (biases) });
  const ratios = ratioPanel(kit);
  if (ratios) sections.push({ title: "Test ratios of fixes", columns: 1, panels: [ratios] });

  const watcher = new IntersectionObserver(
    (entries) => {
      for (const entry of entries) {
        const found = panels.find((one) => one.plot.element === entry.target);
        if (found) found.seen = entry.isIntersecting;
      }
    },
    { rootMargin: "120px" },
  );
  for (const one of panels) {
    one.plot = timePlot(one.panel, span, ids);
    watcher.observe(one.plot.element);
  }
  let next = 0;
  const redraw = (/** @type {any} */ one) => {
    one.plot.update(longer.length > x.length ? longer : x, one.panel.curves);
    one.due = false;
  };
  addEventListener("beforeprint", () => panels.filter((one) => one.due).forEach(redraw));
  return {
    elements: sections.map((section) => sectionOf(section, section.panels.map((/** @type {any} */ one) => one.plot.element))),
    panels: panels.map((one) => one.panel),
    heading: panels.find((one) => one.panel.title.startsWith("Heading error"))?.plot.element,
    show: (/** @type {number} */ group, /** @type {boolean} */ shown) => panels.forEach((one) => one.plot.show(group, shown)),
    /** Take the records from one place to before another. */
    take: (/** @type {any} */ history, /** @type {number} */ first, /** @type {number} */ after) => {
      for (let place = first; place < after; place++) {
        const time = history.value(at("time").at, place);
        x.push(time);
        for (const one of panels) for (const feed of one.feeds) feed(history, place, time);
      }
      for (const one of panels) one.due = true;
    },
    clear: () => {
      x.length = 0;
      for (const one of panels) {
        for (const curve of one.panel.curves.filter((/** @type {any} */ curve) => curve.kind !== "last"))
          for (const values of [curve.y, curve.low, curve.high]) if (values) values.length = 0;
        one.due = true;
      }
    },
    /** Draw some of the panels that are due, while it runs of those that are seen: a frame has time for a few.
     * @param {boolean} running */
    draw: (running) => {
      for (let some = 0, looked = 0; looked < panels.length && some < AT_ONCE; looked++) {
        const one = panels[next++ % panels.length];
        if (!one.due || (running && !one.seen)) continue;
        redraw(one);
        some++;
      }
    },
    shade: (/** @type {[number, number][]} */ windows) => {
      for (const one of panels) one.panel.shade.splice(0, one.panel.shade.length, ...windows);
    },
    limited: (/** @type {boolean} */ shown) => (limited = shown),
    /** Show the last run too. @param {import("./history.js").Recorded | null} history */
    beside: (history) => {
      const column = (/** @type {(history: import("./history.js").Recorded, record: number) => any} */ read) =>
        history ? Array.from({ length: history.count() }, (_, record) => read(history, record)) : [];
      longer = column((records, record) => records.value(at("time").at, record));
      for (const one of panels) {
        for (const { curve, read } of one.last) curve.y = column(read);
        one.due = true;
      }
    },
    point: (/** @type {number | null} */ time) => panels.forEach((one) => one.plot.point(time)),
  };
}

/** @typedef {(history: import("./history.js").Recorded, record: number, time: number) => any} Read  what a curve has of a record
 * @typedef {{live: any, at: (name: string) => any, add: (title: string, unit: string, more: any) => any}} Kit  what panels are made of */

/** A curve that grows with the records.
 * @param {any} made  the panel
 * @param {string} kind
 * @param {number} group
 * @param {Record<string, Read>} reads  by the name of its values */
function grow(made, kind, group, reads) {
  /** @type {any} */
  const curve = { kind, group };
  made.panel.curves.push(curve);
  for (const [name, read] of Object.entries(reads)) {
    curve[name] = [];
    made.feeds.push((/** @type {Parameters<Read>} */ ...record) => curve[name].push(read(...record)));
  }
}

/** A line of this run, and of an estimator that of the last run below it.
 * @param {any} made  the panel
 * @param {number} group
 * @param {number} place  of an output
 * @param {number} [factor]  from SI */
function addLine(made, group, place, factor = 1) {
  const read = (/** @type {any} */ history, /** @type {number} */ record) => factor * history.value(place, record);
  const last = { curve: { kind: "last", group, y: [] }, read };
  if (group >= 0) made.panel.curves.push(last.curve);
  made.last.push(last);
  grow(made, "line", group, { y: read });
}

/** @param {Kit} kit
 * @param {string} channel
 * @param {() => boolean} limited */
function errorPanel({ live, at, add }, channel, limited) {
  const { title, unit } = live.channels[channel];
  const made = add(`${title} error`, unit, { threshold: thresholdOf(live, channel), wraps: channel.endsWith("_deg") });
  for (const { prefix, channels, stated, group } of live.estimators) {
    const [error, sigma] = [channels.indexOf(channel), stated.indexOf(channel)];
    if (sigma >= 0) {
      /** @type {Read} */
      const three = (history, record) => 3 * history.value(at(`${prefix}sigma`).at + sigma, record);
      grow(made, "band", group, { low: (...record) => -three(...record), high: three });
    }
    if (error >= 0) addLine(made, group, at(`${prefix}error`).at + error);
  }
  const limit = live.limit?.sigma[channel];
  if (limit) grow(made, "limit", -1, { y: (_, __, time) => (limited() ? between(live.limit.time_s, limit, time) : null) });
  return made;
}

/** @param {Kit} kit
 * @param {string} name  of the row
 * @param {string} title
 * @param {any} unit
 * @param {number} factor  from SI
 * @param {number} axis */
function biasPanel({ live, at, add }, name, title, unit, factor, axis) {
  const owners = live.estimators.filter((/** @type {any} */ one) => at(one.prefix + name));
  if (!owners.length) return null;
  const made = add(title, unit, {});
  const true_ = at(`${name}_true`);
  if (true_) addLine(made, -1, true_.at + axis, factor);
  for (const { prefix, group } of owners) addLine(made, group, at(prefix + name).at + axis, factor);
  return made;
}

/** @param {Kit} kit */
function ratioPanel({ live, at, add }) {
  const filters = live.estimators.filter((/** @type {any} */ one) => at(`${one.prefix}nis_used`));
  if (!filters.length) return null;
  const made = add("Innovations over their stated sigmas, rms since the last record", "1", { log: true, level: 1 });
  for (const { prefix, group } of filters) {
    const rows = ["nis_used", "nis_refused", "nis_used_count", "nis_refused_count"].map((name) => at(prefix + name));
    const sum = (/** @type {any} */ history, /** @type {any} */ row, /** @type {number} */ record) => {
      let total = 0;
      for (let k = 0; k < row.size; k++)
        total += history.value(row.at + k, record) - (record ? history.value(row.at + k, record - 1) : 0);
      return total;
    };
    /** The ratio of a record that has a refused fix, or has none. @type {(...given: [boolean, ...Parameters<Read>]) => number | null} */
    const ratio = (withRefused, history, record) => {
      const [used, refused, usedCount, refusedCount] = rows.map((row) => sum(history, row, record));
      const count = usedCount + refusedCount;
      return (count > 0 && refusedCount > 0 === withRefused && Math.sqrt((used + refused) / count)) || null;
    };
    grow(made, "points", group, { y: (...record) => ratio(false, ...record) });
    grow(made, "crosses", group, { y: (...record) => ratio(true, ...record) });
  }
  return made;
}
