/** The part of the time that all plots show: zooming one zooms all. */

import { button, h } from "./dom.js";
import { number } from "./numbers.js";

/** @typedef {{name: string, unit: string, whole?: boolean, log?: boolean}} Axis  what plots are over; whole: in whole numbers; log:
 * on a logarithmic scale */

/** @type {Axis} */
export const TIME = { name: "Time", unit: "s" };

/**
 * @typedef {object} Span
 * @property {() => [number, number]} shown  begin and end, s
 * @property {() => boolean} zoomed  whether a part is shown
 * @property {(begin: number, end: number) => void} set  show this part, as far as there is one
 * @property {(factor: number) => void} zoom  change the length by a factor about its middle
 * @property {(share: number) => void} move  by a share of its length
 * @property {() => void} reset
 * @property {(begin: number, end: number) => void} extend  what there is to show
 * @property {(act: () => void, grown?: boolean) => void} onChange  act when another part is shown; grown: also when all is, and it
 *   has become longer, which plots show with their next values
 */

/** @param {number} begin  s
 * @param {number} end  s
 * @returns {Span} */
export function makeSpan(begin, end) {
  let all = [begin, end];
  let now = [begin, end];
  /** @type {{act: () => void, grown: boolean}[]} */
  const listeners = [];
  const zoomed = () => now[0] > all[0] || now[1] < all[1];
  /** @type {Span["set"]} */
  const set = (from, until) => {
    const to = until === Infinity ? all[1] : until;
    const least = (all[1] - all[0]) * 1e-5;
    const length = Math.max(least, Math.min(to - from, all[1] - all[0]));
    const first = Math.min(Math.max(from, all[0]), all[1] - length);
    now = [first, first + length];
    for (const { act } of listeners) act();
  };
  return {
    shown: () => [now[0], now[1]],
    zoomed,
    set,
    zoom: (factor) => {
      const [middle, half] = [(now[0] + now[1]) / 2, ((now[1] - now[0]) / 2) * factor];
      set(middle - half, middle + half);
    },
    move: (share) => set(now[0] + share * (now[1] - now[0]), now[1] + share * (now[1] - now[0])),
    reset: () => set(all[0], all[1]),
    extend: (from, to) => {
      const whole = !zoomed();
      all = [from, to];
      if (!whole) return;
      now = [from, to];
      for (const { act, grown } of listeners) if (grown) act();
    },
    onChange: (act, grown = true) => listeners.push({ act, grown }),
  };
}

/** A place on the axis as text.
 * @param {number} value
 * @param {Axis} axis */
export function along(value, axis) {
  return axis.whole && Number.isInteger(value) ? String(value) : number(value);
}

/** The fields that show and set the span, and the button that shows everything.
 * @param {Span} span
 * @param {Axis} axis
 * @param {number | null} from  start of the statistics, s */
export function spanControls(span, axis = TIME, from = null) {
  const unit = axis.unit ? ` ${axis.unit}` : "";
  const begin = h("input", { type: "text", inputmode: "decimal", id: "span-begin", size: 7, autocomplete: "off" });
  const end = h("input", { type: "text", inputmode: "decimal", id: "span-end", size: 7, autocomplete: "off" });
  const reset = button("Whole run", () => span.reset(), { class: "quiet", id: "span-reset" });
  const late = button("Statistics", () => span.set(Number(from), Infinity), {
    class: "quiet",
    title: `From ${from} s on, where the statistics are taken`,
  });
  const wrong = h("span", { class: "wrong", role: "alert", id: "span-wrong" });
  const show = () => {
    const [from, to] = span.shown();
    begin.value = along(from, axis);
    end.value = along(to, axis);
    wrong.textContent = "";
    reset.disabled = !span.zoomed();
  };
  const take = () => {
    const [from, to] = [Number(begin.value), Number(end.value)];
    if (begin.value.trim() !== "" && end.value.trim() !== "" && to > from) span.set(from, to);
    else wrong.textContent = `${axis.name} ${begin.value} to ${end.value}${unit}: allowed are two numbers, the first one smaller.`;
  };
  for (const field of [begin, end]) field.addEventListener("change", take);
  span.onChange(show);
  show();
  return h(
    "div",
    { class: "span", role: "group", "aria-label": `${axis.name} shown` },
    h("label", { for: "span-begin" }, axis.name),
    begin,
    h("label", { for: "span-end" }, "to"),
    end,
    axis.unit && h("span", {}, axis.unit),
    from !== null && late,
    reset,
    wrong,
  );
}
