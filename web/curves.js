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
    const paint = () => groupColour(curve.group);
    const first = series.length + 1;
    if (curve.kind === "band" || curve.kind === "between") {
      series.push(
        { stroke: "transparent", width: 0, points: { show: false } },
        { stroke: "transparent", width: 0, points: { show: false } },
      );
      const fill = () => (hidden.has(curve.group) ? "transparent" : faint(paint(), 0.16 * (curve.strength ?? 1)));
      bands.push({ series: [first, first + 1], fill });
      owners.push(curve, curve);
    } else if (curve.kind === "limit") {
      const line = {
        stroke: () => (curve.group < 0 ? colour("limit") : paint()),
        width: 1.1,
        dash: [5, 3],
        points: { show: false },
      };
      series.push({ ...line }, { ...line });
      owners.push(curve, curve);
    } else if (curve.kind === "line" || curve.kind === "last") {
      const line =
        curve.kind === "last" ? { stroke: () => faint(paint(), 0.75), width: 0.8 } : { stroke: paint, width: curve.group < 0 ? 4 : 1.3 };
      series.push({ ...line, points: { show: false }, ...(wraps ? { paths: wrapped } : {}) });
      owners.push(curve);
    } else if (curve.kind === "thin") {
      series.push({ stroke: () => faint(paint(), 0.4), width: 0.8, points: { show: false } });
      owners.push(curve);
    } else {
      const size = curve.kind === "points" ? 2.5 : 7;
      series.push({
        stroke: paint,
        width: 1,
        paths: () => null,
        points: { show: true, size, fill: paint, stroke: paint, ...(curve.kind === "crosses" ? { paths: crosses } : {}) },
      });
      owners.push(curve);
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
      found.push(
        curve.y,
        curve.y?.map((value) => (value === null ? null : -value)),
      );
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
