/** Runs a scenario and its estimators as WebAssembly, in a worker or in Node.  The messages are described in docs/page.md. */

import { Machine } from "./machine.js";
import { tomlOf, withSetting } from "./toml.js";
import { Unit, joined } from "./unit.js";

const FRAME_MS = 1000 / 60; // between two frames
const SLICE_MS = 12; // of simulation before messages are read
const TICK_MS = 8; // between two looks at the clock
const CLOUD_RECORDS = 300; // about the number of records of one unit of a cloud
const LATE = 1e9; // s: the end of an outage that has not ended
const NOW = () => performance.now();

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
      this.fail(error);
    }
  }

  fail(error) {
    this.running = false;
    this.cloud = null;
    this.post({ got: "error", message: String(error.message ?? error) });
  }

  async do_load({ live }) {
    this.machine = await Machine.load(live);
    this.live = live;
    this.unit = new Unit(this.machine, 64);
    this.post({ got: "ready" });
    this.do_reset({ seed: live.seed, values: {} });
  }

  /** Start again. `commands`: [{sample, values by name}], as `values` messages have them; the scenario's if not given.
   *  What cannot be started leaves the page at the start of what ran before. */
  do_reset({ seed, values, commands }) {
    this.running = false;
    this.cloud = null;
    const before = { seed: this.seed, values: this.values, commands: this.unit.commands };
    try {
      this.begin({ seed, values: structuredClone(values ?? {}), commands: commands ?? this.live.commands?.given ?? [] });
    } catch (error) {
      if (before.values) this.begin(before);
      throw error;
    }
  }

  begin({ seed, values, commands }) {
    this.unit.begin(seed, values, commands);
    this.seed = seed;
    this.values = values;
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
    this.unit.steer(values);
  }

  /** What a link must hold to repeat this run. */
  do_values() {
    this.post({ got: "values", seed: this.seed, values: this.values, commands: this.unit.commands });
  }

  /** Begin or end an outage of a sensor now; it is part of the scenario that the page gives. */
  do_cut({ sensor, on }) {
    const outage = this.live.outages.find((one) => one.sensor === sensor);
    if (!outage) throw new Error(`this page has no sensor ${JSON.stringify(sensor)} to cut off`);
    const own = this.live.values[sensor]?.outages_s ?? [];
    const windows = structuredClone(this.values[outage.key] ?? own);
    // half a sample later: whatever is measured at this sample is measured already
    const now = (this.unit.sample + 0.5) / this.live.rate_hz;
    const open = windows.find(([begin, end]) => begin <= now && now < end);
    if (on && !open) windows.push([now, LATE]);
    if (!on && open) open[1] = now;
    if (!on && open && open[0] >= open[1]) windows.splice(windows.indexOf(open), 1);
    this.machine.setOutages(outage, windows, this.unit.p);
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
    const { rate_hz: rate } = this.live, { commands } = this.unit;
    if (commands.length) setting.commands = commands.map(({ sample, values }) => ({ at_s: sample / rate, ...values }));
    this.post({
      got: "toml",
      name: `${this.live.name || "scenario"}.toml`,
      text: tomlOf(withSetting(this.live.values, setting)),
    });
  }

  advance(n) {
    const records = this.unit.advance(n, this.live.every);
    if (records.length) this.kept.push(records);
  }

  tick() {
    if (this.cloud) return;
    if (!this.running) return;
    try {
      const began = NOW();
      const left = () => this.live.samples - this.unit.sample;
      let due = left();
      if (this.speed !== Infinity) {
        const elapsed = Math.floor(((began - this.anchor.ms) / 1000) * this.speed * this.live.rate_hz);
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
      this.fail(error);
    }
  }

  /** Show the outputs now, and the records since the last frame. @param {"reset" | "frame" | "end"} got */
  frame(got) {
    const outputs = this.unit.outputs();
    const records = joined(this.kept);
    const { sample } = this.unit;
    this.kept = [];
    this.shown = NOW();
    this.post(
      { got, sample, time_s: sample / this.live.rate_hz, running: this.running, seed: this.seed, outputs, records },
      [outputs.buffer, records.buffer],
    );
  }

  /** Run further seeds to the end under the same commands, one after the other; errors of each are posted when it is done. */
  do_cloud({ units }) {
    if (!(Number.isInteger(units) && units >= 0 && units <= 1024)) throw new Error(`units = ${units}: allowed is 0 to 1024`);
    this.running = false;
    this.cloud = null;
    if (units === 0) return;
    this.spare ??= new Unit(this.machine, 64);
    const { every, samples } = this.live;
    const records = samples / every;
    let sparse = Math.ceil(records / CLOUD_RECORDS);
    while (records % sparse) ++sparse;
    const { seeds } = this.machine;
    const first = Math.max(0, Math.min(seeds.indexOf(this.seed), seeds.length - units));
    this.cloud = { seeds: seeds.slice(first, first + units), done: 0, every: every * sparse, records: null };
    this.puff(this.cloud);
  }

  /** One slice of a cloud. */
  puff(cloud) {
    if (this.cloud !== cloud) return;
    try {
      const { spare, live } = this;
      const began = NOW();
      if (!cloud.records) {
        spare.begin(cloud.seeds[cloud.done], this.values, this.unit.commands);
        cloud.records = [];
      }
      while (spare.sample < live.samples && NOW() - began < SLICE_MS) {
        cloud.records.push(spare.advance(Math.min(cloud.every, live.samples - spare.sample), cloud.every));
      }
      if (spare.sample >= live.samples) {
        this.post(this.puffed(cloud, cloud.records.filter((row) => row.length)));
        cloud.records = null;
      }
      if (cloud.done === cloud.seeds.length) this.cloud = null;
      else setTimeout(() => this.puff(cloud), 0);
    } catch (error) {
      this.fail(error);
    }
  }

  /** The message about a unit that is done. @param {Float64Array[]} rows */
  puffed(cloud, rows) {
    const { estimators, rate_hz: rate, tables } = this.live;
    const pick = (name) => {
      const row = tables.outputs.find((one) => one.name === name);
      const all = new Float64Array(rows.length * row.size);
      rows.forEach((record, k) => all.set(record.subarray(row.at, row.at + row.size), k * row.size));
      return all;
    };
    const seed = cloud.seeds[cloud.done++];
    return {
      got: "cloud",
      seed,
      done: cloud.done,
      units: cloud.seeds.length,
      interval_s: cloud.every / rate,
      errors: estimators.map(({ prefix }) => pick(`${prefix}error`)),
    };
  }
}

if (typeof WorkerGlobalScope !== "undefined" && self instanceof WorkerGlobalScope) {
  const session = new Session((message, transfer) => self.postMessage(message, transfer));
  let last = Promise.resolve(); // messages are taken one after the other
  self.onmessage = ({ data }) => {
    last = last.then(() => session.receive(data));
  };
} else if (typeof module !== "undefined") {
  module.exports = { Session };
}
