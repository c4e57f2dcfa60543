/** The WebAssembly of a live page, and what its document says of parameters: seeds, controls, outages. */

import { bytesOf, numbersOf, piped } from "./arrays.js";
import { checkWindows } from "./checks.js";
import { beyond, oneOf, rangesOf } from "./words.js";

/** @type {Record<string, (value: number, scale: number) => number>} */
const FORMS = {
  product: (value, scale) => scale * value,
  quotient: (value, scale) => value / scale,
  degrees: (value, scale) => (value * Math.PI) / scale,
  inverse: (value, scale) => scale * (1 / value),
};

/** The module, and what the document says of it. */
export class Machine {
  /** @param {any} live  the document
   * @param {WebAssembly.Instance} instance */
  constructor(live, instance) {
    this.live = live;
    this.exports = /** @type {any} */ (instance.exports);
    this.free = (this.exports.__heap_base.value + 15) & ~15;
    this.start = { p: numbersOf(live.start.p), known: numbersOf(live.start.known), u: numbersOf(live.start.u) };
    const range = (/** @type {number[]} */ [first, last]) => Array.from({ length: last - first + 1 }, (_, k) => first + k);
    /** @type {number[]} those that the page offers */
    this.seeds = live.seeds.numbers.flatMap(range);
    this.drawn = this.drawAll(live.seeds.others);
    /** @type {Map<string, any>} */
    this.controls = new Map((live.controls ?? []).map((/** @type {any} */ control) => [control.key, control]));
  }

  /** @param {any} live
   * @returns {Promise<Machine>} */
  static async load(live) {
    const module = new WebAssembly.Module(await piped(bytesOf(live.wasm), new DecompressionStream("gzip")));
    return new Machine(live, new WebAssembly.Instance(module));
  }

  /** Addresses of vectors of float64 of these lengths.
   * @param {number[]} lengths
   * @returns {number[]} */
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

  /** The standard normals behind the start errors of all seeds: computed, and those of the document that the module does not compute.
   * @param {string[]} others  their places, and what is there
   * @returns {Float64Array} */
  drawAll(others) {
    const [place] = this.reserve([9]);
    const all = new Float64Array(9 * this.seeds.length);
    this.seeds.forEach((seed, k) => {
      this.exports.normals(seed, place);
      all.set(new Float64Array(this.exports.memory.buffer, place, 9), 9 * k);
    });
    const [at, values] = others.map(numbersOf);
    at.forEach((one, k) => (all[one] = values[k]));
    return all;
  }

  /** The standard normals behind the start errors of a seed.
   * @param {number} seed
   * @returns {Float64Array} */
  normals(seed) {
    const place = this.seeds.indexOf(seed);
    if (place < 0) throw new Error(`seed = ${seed}: allowed is ${rangesOf(this.live.seeds.numbers)}`);
    return this.drawn.subarray(9 * place, 9 * place + 9);
  }

  /** Set what controls stand for.  Options go before numbers: those may replace numbers of a grade.
   * @param {Record<string, any>} values  by key
   * @param {Float64Array} p
   * @param {Float64Array} known */
  apply(values, p, known) {
    const rank = (/** @type {string} */ key) => (this.controls.get(key)?.options ? 0 : 1);
    for (const key of Object.keys(values).sort((a, b) => rank(a) - rank(b))) this.set(key, values[key], p, known);
  }

  /** @param {string} key
   * @param {any} value
   * @param {Float64Array} p
   * @param {Float64Array} known */
  set(key, value, p, known) {
    const outage = this.live.outages.find((/** @type {any} */ one) => one.key === key);
    if (outage) {
      this.setOutages(outage, value, p);
      return;
    }
    const control = this.controls.get(key);
    if (!control) throw new Error(`${key}: this page has no control of that name`);
    if (control.options) {
      const option = control.options.find((/** @type {any} */ one) => one.value === value);
      if (!option) {
        const names = control.options.map((/** @type {any} */ one) => one.value);
        throw new Error(oneOf(key, String(value), names));
      }
      for (const [at, number] of option.p) p[at] = number;
      return;
    }
    if (typeof value !== "number" || !(value >= control.minimum && value <= control.maximum)) {
      throw new Error(beyond(control, value));
    }
    for (const target of control.targets) {
      const into = target.into === "known" ? known : p;
      const number = FORMS[target.form](value, target.scale);
      for (const at of target.at) into[at] = number;
      for (const at of target.stated) known[at] = 1;
    }
  }

  /** @param {{key: string, start: number, end: number, most: number}} outage
   * @param {number[][]} windows  s
   * @param {Float64Array} p */
  setOutages(outage, windows, p) {
    checkWindows(outage, windows);
    for (let k = 0; k < outage.most; ++k) {
      [p[outage.start + k], p[outage.end + k]] = windows[k] ?? [0, 0];
    }
  }
}
