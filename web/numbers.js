/** Numbers as text, as `insenv run` prints them, and round steps for axes. */

const MINUS = "\u2212";

/**
 * Three significant digits; a dash for an unknown value. The same text as `number` of insenv/report/tables.py.
 * @param {number | null | undefined} value
 */
export function number(value) {
  if (value === null || value === undefined || !Number.isFinite(value)) return "-";
  if (value === 0) return "0";
  const size = Math.abs(value);
  if (size < 1e-4 || size >= 999999.5) {
    const [digits, power] = value.toExponential(1).split("e");
    return `${digits}e${power[0]}${power.slice(1).padStart(2, "0")}`;
  }
  return decimal(value, Math.max(0, 2 - Math.floor(Math.log10(size))));
}

/** So many significant digits without zeros at the end, as the format "g" of Python.
 * @param {number} value
 * @param {number} digits
 * @returns {string} */
export function significant(value, digits) {
  if (!Number.isFinite(value)) return Number.isNaN(value) ? "nan" : value > 0 ? "inf" : "-inf";
  if (value === 0) return "0";
  const [lead, power] = value.toExponential(digits - 1).split("e");
  const bare = (/** @type {string} */ text) => (text.includes(".") ? text.replace(/\.?0+$/, "") : text);
  if (Number(power) >= -4 && Number(power) < digits) return bare(decimal(value, digits - 1 - Number(power)));
  return `${bare(lead)}e${power[0]}${power.slice(1).padStart(2, "0")}`;
}

/** A number with so many decimals; a tie goes to the even digit, as in Python.
 * @param {number} value
 * @param {number} decimals */
function decimal(value, decimals) {
  const further = 40; // a tie has fewer decimals
  const exact = value.toFixed(decimals + further);
  const cut = exact.slice(0, -further).replace(/\.$/, "");
  return /^50*$/.test(exact.slice(-further)) && /[02468]$/.test(cut) ? cut : value.toFixed(decimals);
}

/** A figure without a power of ten, so that those of a column have one form; far from 1 it stays as it is.
 * @param {string} text  as `number` gives it */
export function plain(text) {
  const [, digits, power] = /^-?(\d\.\d)e([+-]\d+)$/.exec(text) ?? [];
  return digits === undefined || Math.abs(Number(power)) > 7 ? text : Number(text).toFixed(Math.max(0, 1 - Number(power)));
}

/** A figure as it is printed, with a typographic minus, in the exponent too.
 * @param {string} text */
export function minus(text) {
  return text.replace(/(^|\de)-(?=\d)/g, `$1${MINUS}`);
}

/** A number for an axis: as short as it can be, with a typographic minus.
 * @param {number} value */
export function tick(value) {
  if (value === 0) return "0";
  const size = Math.abs(value);
  const text = size >= 1e-4 && size < 1e6 ? String(Number(value.toPrecision(6))) : value.toExponential().replace("e+", "e");
  return text.replaceAll("-", MINUS);
}

/** A fixed number of decimals, with a typographic minus.
 * @param {number | null | undefined} value
 * @param {number} decimals */
export function fixed(value, decimals) {
  if (value === null || value === undefined || !Number.isFinite(value)) return "-";
  const text = value.toFixed(decimals);
  return text.replace("-", Number(text) === 0 ? "" : MINUS);
}

/** A time as minutes and seconds.
 * @param {number} seconds */
export function clock(seconds) {
  const whole = Math.floor(seconds + 1e-9);
  const tenths = Math.floor((seconds - whole) * 10 + 1e-6);
  return `${Math.floor(whole / 60)}:${String(whole % 60).padStart(2, "0")}.${tenths}`;
}

/** The largest of 1, 2, 5, 10, ... that is not above `value`.
 * @param {number} value */
export function roundDown(value) {
  const power = 10 ** Math.floor(Math.log10(value));
  const step = [5, 2, 1].find((one) => one * power <= value * (1 + 1e-9)) ?? 1;
  return step * power;
}

/** The smallest of 1, 2, 5, 10, ... that is not below `value`.
 * @param {number} value */
export function roundUp(value) {
  const power = 10 ** Math.floor(Math.log10(value));
  return ([1, 2, 5].find((one) => value <= one * power * (1 + 1e-9)) ?? 10) * power;
}

/** Round values from `low` to `high`, about `count` of them.
 * @param {number} low
 * @param {number} high
 * @param {number} count
 * @param {boolean} [whole]  only whole numbers */
export function ticks(low, high, count, whole = false) {
  if (!(high > low)) return [low];
  const rough = (high - low) / Math.max(1, whole ? Math.min(count, high - low) : count);
  const least = roundDown(rough);
  const step =
    [least, 2 * least, 2.5 * least, 5 * least, 10 * least].find((one) => {
      const lead = one / 10 ** Math.floor(Math.log10(one) + 1e-9);
      return one >= rough * (1 - 1e-9) && Math.abs(lead - 2.5) > 0.01;
    }) ?? 10 * least;
  const found = [];
  for (let place = Math.ceil(low / step - 1e-9); place * step <= high * (1 + 1e-9) + step * 1e-9; place++) {
    found.push(Number((place * step).toPrecision(12)));
  }
  return whole ? found.filter(Number.isInteger) : found;
}
