// Runs a scenario and its estimators as WebAssembly, in a worker or in Node.  The messages are described in docs/page.md.
"use strict";

/** @typedef {{name: string, at: number, size: number, unit: string, meaning: string, minimum?: number, maximum?: number}} Row */

const FRAME_MS = 1000 / 60; // between two frames
const SLICE_MS = 12; // of simulation before messages are read
const TICK_MS = 8; // between two looks at the clock
const CLOUD_RECORDS = 300; // about the number of records of one unit of a cloud
const SHORT = 1e-12; // squared norm below which a quaternion is no attitude
const LATE = 1e9; // s: the end of an outage that has not ended
const FORMS = {
  product: (value, scale) => scale * value,
  degrees: (value, scale) => (value * Math.PI) / scale,
  inverse: (value, scale) => scale * (1 / value),
};
const NOW = () => performance.now();

/** Bytes of base64 text. @param {string} text @returns {Uint8Array} */
function bytesOf(text) {
  if (typeof Uint8Array.fromBase64 === "function") return Uint8Array.fromBase64(text);
  return Uint8Array.from(atob(text), (letter) => letter.charCodeAt(0));
}

/** Float64 numbers of base64 text, little endian. @param {string} text @returns {Float64Array} */
function numbersOf(text) {
  const bytes = bytesOf(text);
  return new Float64Array(bytes.buffer.slice(bytes.byteOffset, bytes.byteOffset + bytes.byteLength));
}

/** The bytes of a gzip file. @param {Uint8Array} bytes @returns {Promise<Uint8Array>} */
async function unzipped(bytes) {
  const stream = new Blob([bytes]).stream().pipeThrough(new DecompressionStream("gzip"));
  return new Uint8Array(await new Response(stream).arrayBuffer());
}

/** One instance of the model: parameters, state, inputs and outputs in the module's memory. */
class Unit {
  /** @param {Machine} machine @param {number} records that one call may give */
  constructor(machine, records) {
    const { p, x, u, y } = machine.live.sizes;
    this.machine = machine;
    this.records = records;
    this.place = machine.reserve([p, x, u, y * records, 36]);
  }

  /** @param {number} which @param {number} size @returns {Float64Array} a view, valid until memory grows */
  view(which, size) {
    return new Float64Array(this.machine.exports.memory.buffer, this.place[which], size);
  }

  get p() { return this.view(0, this.machine.live.sizes.p); }
  get x() { return this.view(1, this.machine.live.sizes.x); }
  get u() { return this.view(2, this.machine.live.sizes.u); }
  get y() { return this.view(3, this.machine.live.sizes.y); }

  /** Start with a seed and the values of controls by key. @param {number} seed @param {Object<string, number>} values */
  begin(seed, values) {
    const { machine } = this, { live } = machine, known = this.view(4, 36);
    this.p.set(machine.start.p);
    this.u.set(machine.start.u);
    known.set(machine.start.known);
    known.set(machine.normals(seed), 0);
    this.p[live.seed_place] = seed;
    const order = Object.keys(values).sort((a, b) => machine.rank(a) - machine.rank(b));
    for (const key of order) machine.apply(key, values[key], this.p, known);
    this.x.fill(0);
    if (machine.exports.begin(this.place[4], this.place[0], this.place[1]) !== 0) {
      throw new Error("the reported start is beyond a full turn: choose a smaller error or standard deviation of the angles");
    }
    this.sample = 0;
  }

  /** Advance n times; gives the outputs at each multiple of `every` samples. @returns {Float64Array} one row after the other */
  run(n, every) {
    const { exports, live } = this.machine, [p, x, u, y] = this.place, width = live.sizes.y, rows = [];
    const keep = (count) => rows.push(new Float64Array(exports.memory.buffer, y, count * width).slice());
    while (n > 0) {
      const off = this.sample % every;
      if (off || n < every) {
        const some = Math.min(n, every - off);
        exports.run(p, x, u, y, 0, some);
        this.sample += some;
        n -= some;
        if (this.sample % every === 0) exports.output(p, x, y), keep(1);
      } else {
        const count = Math.min(Math.floor(n / every), this.records);
        exports.run(p, x, u, y, every, count * every);
        this.sample += count * every;
        n -= count * every;
        keep(count);
      }
    }
    return joined(rows);
  }

  /** The outputs now. @returns {Float64Array} */
  outputs() {
    this.machine.exports.output(this.place[0], this.place[1], this.place[3]);
    return this.y.slice();
  }
}

/** @param {Float64Array[]} rows @returns {Float64Array} */
function joined(rows) {
  if (rows.length === 1) return rows[0];
  const all = new Float64Array(rows.reduce((sum, row) => sum + row.length, 0));
  let at = 0;
  for (const row of rows) all.set(row, at), at += row.length;
  return all;
}

/** The module, and what the document says of it. */
class Machine {
  /** @param {object} live the document @param {WebAssembly.Instance} instance */
  constructor(live, instance) {
    this.live = live;
    this.exports = instance.exports;
    this.free = (instance.exports.__heap_base.value + 15) & ~15;
    this.start = { p: numbersOf(live.start.p), known: numbersOf(live.start.known), u: numbersOf(live.start.u) };
    this.drawn = numbersOf(live.seeds.normals);
    this.controls = new Map((live.controls ?? []).map((control) => [control.key, control]));
  }

  /** @param {object} live @returns {Promise<Machine>} */
  static async load(live) {
    const module = new WebAssembly.Module(await unzipped(bytesOf(live.wasm)));
    return new Machine(live, new WebAssembly.Instance(module));
  }

  /** Addresses of vectors of float64 of these lengths. @param {number[]} lengths @returns {number[]} */
  reserve(lengths) {
    const places = lengths.map((length) => {
      const place = this.free;
      this.free += 8 * Math.max(length, 1);
      return place;
    });
    const lacking = this.free - this.exports.memory.buffer.byteLength;
    if (lacking > 0) this.exports.memory.grow(Math.ceil(lacking / 65536));
    return places;
  }

  /** The standard normals behind the start errors of a seed. @param {number} seed @returns {Float64Array} */
  normals(seed) {
    let before = 0;
    for (const [first, last] of this.live.seeds.numbers) {
      if (seed >= first && seed <= last && Number.isInteger(seed)) {
        const at = 9 * (before + seed - first);
        return this.drawn.subarray(at, at + 9);
      }
      before += last - first + 1;
    }
    const offered = this.live.seeds.numbers.map(([first, last]) => (first === last ? `${first}` : `${first} to ${last}`));
    throw new Error(`seed = ${seed}: this page offers the seeds ${offered.join(", ")}`);
  }

  /** Options go before numbers: those may replace numbers of a grade. @param {string} key @returns {number} */
  rank(key) {
    return this.controls.get(key)?.options ? 0 : 1;
  }

  /** Set what a control stands for. @param {string} key @param {Float64Array} p @param {Float64Array} known */
  apply(key, value, p, known) {
    const outage = this.live.outages.find((one) => one.key === key);
    if (outage) {
      this.applyOutages(outage, value, p);
      return;
    }
    const control = this.controls.get(key);
    if (!control) throw new Error(`${key}: this page has no control of that name`);
    if (control.options) {
      const option = control.options.find((one) => one.value === value);
      if (!option) throw new Error(`${key} = ${JSON.stringify(value)}: allowed is ${control.options.map((one) => one.value).join(", ")}`);
      for (const [at, number] of option.p) p[at] = number;
      return;
    }
    const unit = control.unit ? ` ${control.unit}` : "";
    if (typeof value !== "number" || !(value >= control.minimum && value <= control.maximum)) {
      throw new Error(`${key} = ${value}${unit}: allowed is ${control.minimum} to ${control.maximum}${unit}`);
    }
    for (const target of control.targets) {
      const into = target.into === "known" ? known : p, number = FORMS[target.form](value, target.scale);
      for (const at of target.at) into[at] = number;
      for (const at of target.given) known[at] = 1;
    }
  }

  /** @param {{key: string, start: number, end: number, most: number}} outage @param {number[][]} windows in s */
  applyOutages(outage, windows, p) {
    const good = Array.isArray(windows) && windows.every((one) => Array.isArray(one) && one.length === 2 && one[0] >= 0 && one[0] < one[1]);
    if (!good) throw new Error(`${outage.key}: allowed are pairs of a begin of 0 s or later and an end after it`);
    if (windows.length > outage.most) throw new Error(`${outage.key}: at most ${outage.most} outages, ${windows.length} given`);
    for (let k = 0; k < outage.most; ++k) {
      [p[outage.start + k], p[outage.end + k]] = windows[k] ?? [0, 0];
    }
  }
}

/** The text of a scenario file. @param {object} values by key @returns {string} */
function tomlOf(values) {
  const lines = [], tables = [];
  const isTable = (value) => typeof value === "object" && value !== null && !Array.isArray(value);
  const write = (table, path) => {
    for (const [key, value] of Object.entries(table)) if (!isTable(value) && value !== null) lines.push(`${keyOf(key)} = ${textOf(value)}`);
    for (const [key, value] of Object.entries(table)) {
      if (!isTable(value)) continue;
      const name = [...path, keyOf(key)];
      lines.push("", `[${name.join(".")}]`);
      write(value, name);
    }
  };
  write(values, tables);
  return `${lines.join("\n")}\n`;
}

function keyOf(key) {
  return /^[\w-]+$/.test(key) ? key : JSON.stringify(key);
}

function textOf(value) {
  if (Array.isArray(value)) return `[${value.map(textOf).join(", ")}]`;
  if (typeof value === "object") {
    const pairs = Object.entries(value).filter(([, one]) => one !== null);
    return `{ ${pairs.map(([key, one]) => `${keyOf(key)} = ${textOf(one)}`).join(", ")} }`;
  }
  if (typeof value === "number") return Object.is(value, -0) ? "-0.0" : String(value);
  return JSON.stringify(value); // texts, true, false: as in JSON
}

/** Values with some changed by dotted key. @returns {object} */
function changed(values, setting) {
  const copy = structuredClone(values);
  for (const [key, value] of Object.entries(setting)) {
    const path = key.split("."), last = path.pop();
    let here = copy;
    for (const part of path) here = here[part] ??= {};
    here[last] = value;
  }
  return copy;
}

/** What the page talks to: one run, driven by messages. */
class Session {
  /** @param {(message: object, transfer?: ArrayBuffer[]) => void} post */
  constructor(post) {
    this.post = post;
    this.channel = new MessageChannel();
    this.channel.port1.onmessage = () => this.tick();
  }

  /** @param {object} message */
  async receive(message) {
    try {
      await this[`do_${message.do}`](message);
    } catch (error) {
      this.running = false;
      this.post({ got: "error", message: String(error.message ?? error) });
    }
  }

  async do_load({ live }) {
    this.machine = await Machine.load(live);
    this.live = live;
    this.unit = new Unit(this.machine, 64);
    this.post({ got: "ready" });
    this.do_reset({ seed: live.seed, values: {} });
  }

  /** Start again. `commands`: [{sample, values by name}], as `values` messages have them; the scenario's if not given. */
  do_reset({ seed, values, commands }) {
    this.running = false;
    this.cloud = null;
    this.unit.begin(seed, values ?? {});
    this.seed = seed;
    this.values = structuredClone(values ?? {});
    this.commands = structuredClone(commands ?? this.live.commands?.given ?? []);
    this.checkCommands();
    this.followed = 0;
    this.kept = [];
    this.frame("reset");
  }

  do_run({ speed }) {
    this.speed = speed === null || speed === undefined ? Infinity : speed; // JSON has no Infinity
    if (!(this.speed > 0)) throw new Error(`speed = ${speed}: allowed is a number above 0, or null for as fast as it goes`);
    this.anchor = { ms: NOW(), sample: this.unit.sample };
    if (!this.running) {
      this.running = true;
      this.shown = -Infinity;
      this.tick();
    }
  }

  do_pause() {
    this.running = false;
    this.frame("frame");
  }

  do_step({ samples }) {
    this.running = false;
    this.advance(Math.min(samples, this.live.samples - this.unit.sample));
    this.frame(this.unit.sample >= this.live.samples ? "end" : "frame");
  }

  /** Commands from now on, by name, in SI; those that are not named keep what is in force. */
  do_input({ values }) {
    const { commands } = this.live, { sample, x } = this.unit;
    if (!commands) throw new Error("the vehicle of this scenario takes no commands");
    this.commands.length = this.followed; // whoever steers replaces what was to come
    const last = this.commands.at(-1), now = last ? last.values : Object.fromEntries(commands.rows.map((row) => [row.name, x[row.state]]));
    if (last && last.sample === sample) this.commands.pop();
    this.commands.push({ sample, values: { ...now, ...values } });
    this.checkCommands();
    this.followed = this.commands.length - 1;
    this.follow();
  }

  checkCommands() {
    const { commands, tables } = this.live;
    let before = 0;
    for (const { sample, values } of this.commands) {
      if (!commands) throw new Error("the vehicle of this scenario takes no commands");
      if (!(Number.isInteger(sample) && sample >= before)) throw new Error(`commands at sample ${sample}: allowed are whole numbers in order`);
      before = sample;
      for (const [name, value] of Object.entries(values)) {
        const row = tables.inputs.find((one) => one.name === `command_${name}`);
        if (!row) throw new Error(`commands: unknown command ${JSON.stringify(name)}`);
        const least = row.minimum ?? -Infinity, most = row.maximum ?? Infinity;
        if (!(value >= least && value <= most)) throw new Error(`command ${name} = ${value} ${row.unit}: allowed is ${least} to ${most} ${row.unit}`);
      }
    }
  }

  /** Set the inputs to the commands that are due. */
  follow() {
    const { commands } = this.live, { sample, u } = this.unit;
    while (this.followed < this.commands.length && this.commands[this.followed].sample <= sample) {
      const { values } = this.commands[this.followed++];
      for (const row of commands.rows) if (row.name in values) u[row.at] = values[row.name];
      u[commands.valid] = 1;
    }
  }

  /** What a link must hold to repeat this run. */
  do_values() {
    this.post({ got: "values", seed: this.seed, values: this.values, commands: this.commands });
  }

  /** Begin or end an outage of a sensor now; it is part of the scenario that the page gives. */
  do_cut({ sensor, on }) {
    const outage = this.live.outages.find((one) => one.sensor === sensor);
    if (!outage) throw new Error(`this page has no sensor ${JSON.stringify(sensor)} to cut off`);
    const own = sensor in this.live.values ? this.live.values[sensor].outages_s ?? [] : [];
    const windows = structuredClone(this.values[outage.key] ?? own);
    // half a sample later: whatever is measured at this sample is measured already
    const now = (this.unit.sample + 0.5) / this.live.rate_hz;
    const open = windows.find(([begin, end]) => begin <= now && now < end);
    if (on && !open) windows.push([now, LATE]);
    if (!on && open) open[1] = now;
    if (!on && open && open[0] >= open[1]) windows.splice(windows.indexOf(open), 1);
    this.machine.applyOutages(outage, windows, this.unit.p);
    this.values[outage.key] = windows;
    this.do_values();
  }

  /** The scenario file of this run. */
  do_toml() {
    const setting = { seed: this.seed };
    for (const [key, value] of Object.entries(this.values)) {
      const option = this.machine.controls.get(key)?.options?.find((one) => one.value === value);
      Object.assign(setting, option ? option.set : { [key]: value });
    }
    const { rate_hz: rate } = this.live;
    if (this.commands.length) setting.commands = this.commands.map(({ sample, values }) => ({ at_s: sample / rate, ...values }));
    this.post({ got: "toml", name: `${this.live.name || "scenario"}.toml`, text: tomlOf(changed(this.live.values, setting)) });
  }

  advance(n) {
    while (n > 0) {
      this.follow();
      const next = this.commands[this.followed]?.sample ?? Infinity, some = Math.min(n, next - this.unit.sample);
      const records = this.unit.run(some, this.live.every);
      n -= some;
      if (records.length) this.checkFinite(records);
      if (records.length) this.kept.push(records);
    }
  }

  /** As `insenv run` does, stop at outputs that are no numbers and at an attitude without length. @param {Float64Array} records */
  checkFinite(records) {
    const { estimators, sizes, tables } = this.live;
    for (const { id, prefix } of estimators) {
      for (const row of tables.outputs) {
        if (!row.name.startsWith(prefix)) continue;
        for (let at = row.at; at < records.length; at += sizes.y) {
          const values = records.subarray(at, at + row.size);
          if (!values.every(Number.isFinite)) throw new Error(`estimator '${id}' diverged: its outputs are no longer finite numbers`);
          if (row.name === `${prefix}q_nb` && values.reduce((sum, one) => sum + one * one, 0) < SHORT) {
            throw new Error(`estimator '${id}' diverged: its output q_nb has length 0`);
          }
        }
      }
    }
  }

  tick() {
    if (this.cloud) return;
    if (!this.running) return;
    try {
      const began = NOW(), rate = this.live.rate_hz, left = () => this.live.samples - this.unit.sample;
      let due = left();
      if (this.speed !== Infinity) {
        const elapsed = Math.floor(((began - this.anchor.ms) / 1000) * this.speed * rate);
        due = Math.min(due, this.anchor.sample + elapsed - this.unit.sample);
      }
      let behind = false;
      while (due > 0) {
        const some = Math.min(due, 256);
        this.advance(some);
        due -= some;
        behind = due > 0 && NOW() - began > SLICE_MS;
        if (behind) break;
      }
      if (behind && this.speed !== Infinity) this.anchor = { ms: NOW(), sample: this.unit.sample }; // it cannot keep up
      if (left() <= 0) {
        this.running = false;
        this.frame("end");
        return;
      }
      if (NOW() - this.shown >= FRAME_MS) this.frame("frame");
      if (behind) this.channel.port2.postMessage(0);
      else setTimeout(() => this.tick(), TICK_MS);
    } catch (error) {
      this.running = false;
      this.post({ got: "error", message: String(error.message ?? error) });
    }
  }

  /** Show the outputs now, and the records since the last frame. @param {"reset" | "frame" | "end"} got */
  frame(got) {
    const outputs = this.unit.outputs(), records = joined(this.kept), { sample } = this.unit;
    this.kept = [];
    this.shown = NOW();
    this.post(
      { got, sample, time_s: sample / this.live.rate_hz, running: this.running, seed: this.seed, outputs, records },
      [outputs.buffer, records.buffer],
    );
  }

  /** Run further seeds to the end, one after the other; errors of each are posted when it is done. */
  do_cloud({ units }) {
    if (!(Number.isInteger(units) && units >= 0 && units <= 1024)) throw new Error(`units = ${units}: allowed is 0 to 1024`);
    this.running = false;
    this.cloud = null;
    if (units === 0) return;
    this.spare ??= new Unit(this.machine, 64);
    const { every, samples } = this.live, records = samples / every;
    let sparse = Math.ceil(records / CLOUD_RECORDS);
    while (records % sparse) ++sparse;
    const offered = this.live.seeds.numbers.flatMap(([first, last]) => Array.from({ length: last - first + 1 }, (_, k) => first + k));
    const first = Math.max(0, Math.min(offered.indexOf(this.seed), offered.length - units));
    this.cloud = { seeds: offered.slice(first, first + units), done: 0, every: every * sparse, errors: null };
    this.puff(this.cloud);
  }

  puff(cloud) {
    if (this.cloud !== cloud) return;
    try {
      const { spare } = this, { live } = this, began = NOW(), seed = cloud.seeds[cloud.done];
      if (!cloud.records) {
        spare.begin(seed, this.values);
        cloud.records = [];
      }
      while (spare.sample < live.samples && NOW() - began < SLICE_MS) {
        const records = spare.run(Math.min(cloud.every, live.samples - spare.sample), cloud.every);
        if (records.length) this.checkFinite(records);
        cloud.records.push(records);
      }
      if (spare.sample >= live.samples) {
        const rows = cloud.records.filter((row) => row.length), width = live.sizes.y;
        const pick = (name) => {
          const row = live.tables.outputs.find((one) => one.name === name), all = new Float64Array(rows.length * row.size);
          rows.forEach((record, k) => all.set(record.subarray(row.at, row.at + row.size), k * row.size));
          return all;
        };
        const errors = live.estimators.map(({ prefix }) => pick(`${prefix}error`));
        const sigmas = live.estimators.map(({ prefix, stated }) => (stated.length ? pick(`${prefix}sigma`) : null));
        cloud.records = null;
        cloud.done += 1;
        const { done } = cloud, units = cloud.seeds.length;
        this.post({ got: "cloud", seed, done, units, interval_s: cloud.every / live.rate_hz, width, errors, sigmas });
        if (done === units) {
          this.cloud = null;
          return;
        }
      }
      setTimeout(() => this.puff(cloud), 0);
    } catch (error) {
      this.cloud = null;
      this.post({ got: "error", message: String(error.message ?? error) });
    }
  }
}

if (typeof WorkerGlobalScope !== "undefined" && self instanceof WorkerGlobalScope) {
  const session = new Session((message, transfer) => self.postMessage(message, transfer));
  let last = Promise.resolve(); // messages are taken one after the other
  self.onmessage = ({ data }) => { last = last.then(() => session.receive(data)); };
} else if (typeof module !== "undefined") {
  module.exports = { Machine, Session, Unit, numbersOf };
}
