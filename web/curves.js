/** The curves of a panel as series and bands of uPlot. */

import { colour, faint, groupColour } from "./theme.js";

/**
 * @typedef {object} Curve
 * @property {"line" | "last" | "thin" | "points" | "crosses" | "limit" | "band" | "between"} kind
 * @property {number} group  place in the legend; -1: the truth
 * @property {(number | null)[]} [y]
 * @property {(number | null)[]} [low]  of a band
 * @property {(number | null)[]} [high]  of a band
 * @property {number} [strength]  scales the opacity of a band
 */

/** The series and bands of uPlot, and the curve that owns each series.
 * @param {Curve[]} curves
 * @param {Set<number>} hidden
 * @param {boolean} [wraps]  angles in degrees: lines have a gap where they wrap */
export function layout(curves, hidden, wraps = false) {
  /** @type {any[]} */
  const series = [];
  /** @type {any[]} */
  const bands = [];
  /** @type {Curve[]} */
  const owners = [];
  for (const curve of curves) {
    const { kind, group } = curve;
    const paint = () => groupColour(group);
    const faded = (/** @type {number} */ opacity) => () => faint(paint(), opacity);
    const add = (/** @type {any[]} */ ...lines) => {
      series.push(...lines.map((line) => ({ points: { show: false }, ...line })));
      owners.push(...lines.map(() => curve));
    };
    if (kind === "band" || kind === "between") {
      const fill = () => (hidden.has(group) ? "transparent" : faint(paint(), 0.16 * (curve.strength ?? 1)));
      bands.push({ series: [series.length + 1, series.length + 2], fill });
      add(...Array(2).fill({ stroke: "transparent", width: 0 }));
    } else if (kind === "limit") {
      add(...Array(2).fill({ stroke: () => (group < 0 ? colour("limit") : paint()), width: 1.1, dash: [5, 3] }));
    } else if (kind === "points" || kind === "crosses") {
      const points = { show: true, size: kind === "points" ? 2.5 : 7, fill: paint, stroke: paint };
      add({ stroke: paint, width: 1, paths: () => null, points: kind === "crosses" ? { ...points, paths: crosses } : points });
    } else if (kind === "thin") add({ stroke: faded(0.4), width: 0.8 });
    else {
      const line = kind === "last" ? { stroke: faded(0.75), width: 0.8 } : { stroke: paint, width: group < 0 ? 4 : 1.3 };
      add(wraps ? { ...line, paths: wrapped } : line);
    }
  }
  return { series, bands, owners };
}

/** The columns of uPlot.
 * @param {number[]} x
 * @param {Curve[]} curves */
export function columns(x, curves) {
  /** @type {any[]} */
  const found = [x];
  for (const curve of curves) {
    if (curve.kind === "band" || curve.kind === "between") found.push(curve.high, curve.low);
    else if (curve.kind === "limit")
      found.push(curve.y, curve.y?.map((value) => (value === null ? null : -value)));
    else found.push(curve.y);
  }
  return found;
}

/** The curves by which the vertical range is chosen.
 * @param {Curve[]} curves
 * @param {Set<number>} hidden
 * @returns {{y: (number | null)[], kind: string}[]} */
export function ranged(curves, hidden) {
  /** @type {{y: (number | null)[], kind: string}[]} */
  const found = [];
  for (const { kind, group, y, low, high } of curves) {
    if (hidden.has(group)) continue;
    if (kind === "band" && low && high) found.push({ y: low, kind }, { y: high, kind });
    else if (kind === "between" && low && high) found.push({ y: low, kind: "line" }, { y: high, kind: "line" });
    else if (y) found.push({ y, kind });
  }
  return found;
}

/** The path of a line of angles in degrees. Those of uPlot join the values of one pixel, also across a wrap.
 * @param {any} u
 * @param {number} place
 * @param {number} first
 * @param {number} last */
function wrapped(u, place, first, last) {
  const path = new Path2D();
  /** @type {number | null} */
  let before = null;
  for (let at = first; at <= last; at++) {
    const value = u.data[place][at] ?? null;
    if (value !== null) {
      const [x, y] = [u.valToPos(u.data[0][at], "x", true), u.valToPos(value, "y", true)];
      if (before === null || Math.abs(value - before) > 180) path.moveTo(x, y);
      else path.lineTo(x, y);
    }
    before = value;
  }
  return { stroke: path, fill: null, flags: 1 };
}

/** The paths of crosses at the points of a series.
 * @param {any} u
 * @param {number} place
 * @param {number} first
 * @param {number} last */
function crosses(u, place, first, last) {
  const path = new Path2D();
  const half = 3.2 * devicePixelRatio;
  for (let at = first; at <= last; at++) {
    const value = u.data[place][at];
    if (value === null || value === undefined) continue;
    const [x, y] = [u.valToPos(u.data[0][at], "x", true), u.valToPos(value, "y", true)];
    path.moveTo(x - half, y - half);
    path.lineTo(x + half, y + half);
    path.moveTo(x - half, y + half);
    path.lineTo(x + half, y - half);
  }
  return { stroke: path, fill: null, flags: 3 };
}
