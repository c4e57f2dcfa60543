/** One unit on its run: parameters, state, inputs and outputs in the memory of a `Machine`, and the commands that it follows. */

import { checkCommands } from "./checks.js";

/**
 * @typedef {import("./machine.js").Machine} Machine
 * @typedef {import("./checks.js").Command} Command
 */

const SHORT = 1e-12; // squared norm below which a quaternion is no attitude

export class Unit {
  /** @param {Machine} machine
   * @param {number} records  that one call may give */
  constructor(machine, records) {
    const { p, x, u, y } = machine.live.sizes;
    this.machine = machine;
    this.records = records;
    this.sizes = [p, x, u, y, 36];
    this.place = machine.reserve([p, x, u, y * records, 36]);
    this.sample = 0;
    /** @type {Command[]} */
    this.commands = [];
    this.followed = 0;
  }

  /** @param {number} which
   * @returns {Float64Array} a view, valid until memory grows */
  view(which) {
    return new Float64Array(this.machine.exports.memory.buffer, this.place[which], this.sizes[which]);
  }

  get p() { return this.view(0); }
  get x() { return this.view(1); }
  get u() { return this.view(2); }
  get y() { return this.view(3); }

  /** Start with a seed, the values of controls by key, and commands.
   * @param {number} seed
   * @param {Record<string, any>} values
   * @param {Command[]} commands */
  begin(seed, values, commands) {
    const { machine } = this;
    const known = this.view(4);
    checkCommands(machine.live, commands);
    this.p.set(machine.start.p);
    this.u.set(machine.start.u);
    known.set(machine.start.known);
    known.set(machine.normals(seed), 0);
    this.p[machine.live.seed_place] = seed;
    machine.apply(values, this.p, known);
    this.x.fill(0);
    if (machine.exports.begin(this.place[4], this.place[0], this.place[1]) !== 0) {
      throw new Error("the reported start is beyond a full turn: choose a smaller error or standard deviation of the angles");
    }
    this.sample = 0;
    this.commands = structuredClone(commands);
    this.followed = 0;
  }

  /** Commands from now on; those that are not named keep what is in force.  They replace what was to come.
   * @param {Record<string, number>} values */
  steer(values) {
    const { live } = this.machine;
    if (!live.commands) throw new Error("the vehicle of this scenario takes no commands");
    const past = this.commands.slice(0, this.followed);
    const last = past.at(-1);
    const now = last
      ? last.values
      : Object.fromEntries(live.commands.rows.map((/** @type {any} */ row) => [row.name, this.x[row.state]]));
    if (last && last.sample === this.sample) past.pop();
    const commands = [...past, { sample: this.sample, values: { ...now, ...values } }];
    checkCommands(live, commands);
    this.commands = commands;
    this.followed = commands.length - 1;
    this.follow();
  }

  /** Set the inputs to the commands that are due. */
  follow() {
    const { commands } = this.machine.live;
    while (this.followed < this.commands.length && this.commands[this.followed].sample <= this.sample) {
      const { values } = this.commands[this.followed++];
      for (const row of commands.rows) if (row.name in values) this.u[row.at] = values[row.name];
      this.u[commands.valid] = 1;
    }
  }

  /** Advance n times under the commands; gives the outputs at each multiple of `every` samples.
   * @param {number} n
   * @param {number} every
   * @returns {Float64Array} one row after the other */
  advance(n, every) {
    const found = [];
    while (n > 0) {
      this.follow();
      const next = this.commands[this.followed]?.sample ?? Infinity;
      const some = Math.min(n, next - this.sample);
      found.push(this.run(some, every));
      n -= some;
    }
    const records = joined(found);
    checkFinite(this.machine.live, records);
    return records;
  }

  /** @param {number} n
   * @param {number} every */
  run(n, every) {
    const { exports, live } = this.machine;
    const [p, x, u, y] = this.place;
    /** @type {Float64Array[]} */
    const rows = [];
    const keep = (/** @type {number} */ count) =>
      rows.push(new Float64Array(exports.memory.buffer, y, count * live.sizes.y).slice());
    while (n > 0) {
      const off = this.sample % every;
      if (off || n < every) {
        const some = Math.min(n, every - off);
        exports.run(p, x, u, y, 0, some);
        this.sample += some;
        n -= some;
        if (this.sample % every === 0) {
          exports.output(p, x, y);
          keep(1);
        }
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

  /** The outputs now.
   * @returns {Float64Array} */
  outputs() {
    this.machine.exports.output(this.place[0], this.place[1], this.place[3]);
    return this.y.slice();
  }
}

/** @param {Float64Array[]} rows
 * @returns {Float64Array} */
export function joined(rows) {
  if (rows.length === 1) return rows[0];
  const all = new Float64Array(rows.reduce((sum, row) => sum + row.length, 0));
  let at = 0;
  for (const row of rows) {
    all.set(row, at);
    at += row.length;
  }
  return all;
}

/** As `insenv run` does, stop at outputs that are no numbers and at an attitude without length.
 * @param {any} live
 * @param {Float64Array} records */
function checkFinite({ estimators, sizes, tables }, records) {
  for (const { id, prefix } of estimators) {
    for (const row of tables.outputs) {
      if (!row.name.startsWith(prefix)) continue;
      for (let at = row.at; at < records.length; at += sizes.y) {
        const values = records.subarray(at, at + row.size);
        if (!values.every(Number.isFinite)) {
          throw new Error(`estimator '${id}' diverged: its outputs are no longer finite numbers`);
        }
        if (row.name === `${prefix}q_nb` && values.reduce((sum, one) => sum + one * one, 0) < SHORT) {
          throw new Error(`estimator '${id}' diverged: its output q_nb has length 0`);
        }
      }
    }
  }
}
