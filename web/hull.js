/** The vehicle in three dimensions, true (solid) and estimated (outlines), over a compass rose and before the horizon: plain canvas,
 * no GPU needed. */

import { dragged, quarters, sharpCanvas, stroked, traced } from "./canvas.js";
import { meshOf } from "./meshes.js";
import { colour, faint, groupColour } from "./theme.js";

/** @typedef {[number, number, number]} Vector  in n or b, m */

const DISTANCE = 7;
const ELEVATION = 0.3;
const QUARTER = 0.85;
const RADIUS = 2.3; // of the compass rose
const WATER = 0.14; // m below the origin: the water of a ship
const MIDDLE = 0.5; // of the height, where the camera looks
const FAR = 1e5; // m: a point of the horizon

/** A vector in b, turned into n by a quaternion (w, x, y, z) of the attitude.
 * @param {ArrayLike<number>} q
 * @param {Vector} v
 * @returns {Vector} */
export function turned(q, [x, y, z]) {
  const [w, a, b, c] = [q[0], q[1], q[2], q[3]];
  const [tx, ty, tz] = [2 * (b * z - c * y), 2 * (c * x - a * z), 2 * (a * y - b * x)];
  return [x + w * tx + b * tz - c * ty, y + w * ty + c * tx - a * tz, z + w * tz + a * ty - b * tx];
}

/**
 * @param {string} shape  of the vehicle
 */
export function hullView(shape) {
  const { element: canvas, cleared, size } = sharpCanvas({
    class: "hull",
    role: "img",
    "aria-label": "The vehicle seen from its quarter: true attitude solid, estimates as outlines",
  });
  const mesh = meshOf(shape);
  let [azimuth, aside, elevation] = [0, QUARTER, ELEVATION];
  let fresh = true;
  dragged(canvas, (right, up) => {
    aside += 0.008 * right;
    elevation = Math.min(1.5, Math.max(0.05, elevation + 0.006 * up));
  });

  /** @param {ArrayLike<number>} truth  q_nb
   * @param {{group: number, q: ArrayLike<number>}[]} estimates
   * @param {number} heading  deg */
  const draw = (truth, estimates, heading) => {
    const context = cleared();
    const target = (heading * Math.PI) / 180;
    const behind = Math.atan2(Math.sin(target - azimuth), Math.cos(target - azimuth));
    azimuth += fresh ? behind : 0.06 * behind;
    fresh = false;
    const { project, horizon } = camera(azimuth + aside, elevation, size);
    land(context, project, horizon, size, shape === "ship");
    const faces = mesh.map((face) => face.map((corner) => turned(truth, corner)));
    if (shape === "ship") {
      solid(context, project, faces.map((face) => cut(face, 1)).filter((face) => face.length));
      rose(context, project, heading, WATER);
      solid(context, project, faces.map((face) => cut(face, -1)).filter((face) => face.length));
    } else {
      rose(context, project, heading, null);
      solid(context, project, faces);
    }
    context.lineWidth = 1.2;
    for (const { group, q } of estimates) {
      context.strokeStyle = groupColour(group);
      context.fillStyle = faint(groupColour(group), 0.06);
      for (const face of mesh) {
        outline(context, face.map((corner) => project(turned(q, corner))));
        context.fill();
        context.stroke();
      }
    }
  };
  return { element: canvas, draw, reset: () => (fresh = true) };
}

/** The part of a face below (1) or above (-1) the water.
 * @param {Vector[]} face
 * @param {1 | -1} side */
function cut(face, side) {
  const depth = (/** @type {Vector} */ corner) => side * (corner[2] - WATER);
  return face.flatMap((corner, place) => {
    const next = face[(place + 1) % face.length];
    const [a, b] = [depth(corner), depth(next)];
    const share = a / (a - b);
    const edge = /** @type {Vector} */ (corner.map((value, k) => value + share * (next[k] - value)));
    return [...(a >= 0 ? [corner] : []), ...(a * b < 0 ? [edge] : [])];
  });
}

/** A camera that looks at the origin in the direction `azimuth`, from above by `elevation` (rad): what it makes of a point (x, y on
 * the canvas, and the distance), and the height of the horizon on the canvas.
 * @param {number} azimuth
 * @param {number} elevation
 * @param {number[]} size */
export function camera(azimuth, elevation, [width, height]) {
  const [sa, ca, se, ce] = [Math.sin(azimuth), Math.cos(azimuth), Math.sin(elevation), Math.cos(elevation)];
  const focal = Math.min(1.2 * width, 1.38 * height); // with which the letters of the rose stay inside
  /** @param {Vector} point
   * @returns {Vector} */
  const project = ([n, e, d]) => {
    const depth = DISTANCE + n * ca * ce + e * sa * ce + d * se;
    const scale = focal / depth;
    return [width / 2 + scale * (-n * sa + e * ca), MIDDLE * height - scale * (n * ca * se + e * sa * se - d * ce), depth];
  };
  return { project, horizon: MIDDLE * height - (focal * se) / ce };
}

/** The ground or the sea up to the horizon, with a mark every 30 degrees that shows how the vehicle turns.
 * @param {CanvasRenderingContext2D} context
 * @param {(point: Vector) => Vector} project
 * @param {number} horizon
 * @param {number[]} size
 * @param {boolean} sea */
function land(context, project, horizon, [width, height], sea) {
  context.fillStyle = sea ? faint(colour("c5"), 0.14) : faint(colour("muted"), 0.1);
  context.fillRect(0, horizon, width, height - horizon);
  const marks = Array.from({ length: 12 }, (_, k) => project([FAR * Math.cos((k * Math.PI) / 6), FAR * Math.sin((k * Math.PI) / 6), 0]));
  const seen = marks.filter(([, , depth]) => depth > 0).map(([x]) => [[x, horizon], [x, horizon - 5]]);
  stroked(context, colour("zero"), 1, [[0, horizon], [width, horizon]], ...seen);
}

/** @param {CanvasRenderingContext2D} context
 * @param {Vector[]} corners */
function outline(context, corners) {
  traced(context, corners);
  context.closePath();
}

/** Faces from the farthest to the nearest, shaded by their direction.
 * @param {CanvasRenderingContext2D} context
 * @param {(point: Vector) => Vector} project
 * @param {Vector[][]} faces */
function solid(context, project, faces) {
  const shown = faces.map((face) => {
    const corners = face.map(project);
    return { corners, depth: corners.reduce((sum, corner) => sum + corner[2], 0) / corners.length, light: lightOn(face) };
  });
  shown.sort((a, b) => b.depth - a.depth);
  context.lineWidth = 0.8;
  context.strokeStyle = faint(colour("ink"), 0.35);
  for (const { corners, light } of shown) {
    outline(context, corners);
    context.fillStyle = `color-mix(in oklab, ${colour("hull")} ${Math.round(55 + 45 * light)}%, ${colour("shadow")})`;
    context.fill();
    context.stroke();
  }
}

/** The light on a face, 0 to 1: from above and a little from the north-west.
 * @param {Vector[]} face */
function lightOn([a, b, c]) {
  const [u, v] = [b.map((value, k) => value - a[k]), c.map((value, k) => value - a[k])];
  const normal = [u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2], u[0] * v[1] - u[1] * v[0]];
  const length = Math.hypot(...normal) || 1;
  return Math.abs((0.35 * normal[0] - 0.2 * normal[1] - 0.9 * normal[2]) / length);
}

/** A compass rose below the vehicle, with an arrow where its front points, or on the water.
 * @param {CanvasRenderingContext2D} context
 * @param {(point: Vector) => Vector} project
 * @param {number} heading  deg
 * @param {number | null} water  m below the origin */
function rose(context, project, heading, water) {
  const below = water ?? 0.75;
  const at = (/** @type {number} */ degrees, /** @type {number} */ radius) => {
    const angle = (degrees * Math.PI) / 180;
    return project([radius * Math.cos(angle), radius * Math.sin(angle), below]);
  };
  context.strokeStyle = colour("zero");
  context.lineWidth = 1;
  outline(context, Array.from({ length: 72 }, (_, place) => at(5 * place, RADIUS)));
  context.stroke();
  if (water !== null) {
    context.fillStyle = faint(colour("c5"), 0.25);
    context.fill();
  }
  outline(context, [at(heading, RADIUS + 0.05), at(heading + 8, RADIUS - 0.45), at(heading - 8, RADIUS - 0.45)]);
  context.fillStyle = colour("muted");
  context.fill();
  const mark = (/** @type {number} */ degrees) => [at(degrees, RADIUS), at(degrees, degrees % 90 ? 2.18 : 2.05)];
  stroked(context, colour("zero"), 1, ...Array.from({ length: 12 }, (_, k) => mark(30 * k)));
  quarters(context, (degrees) => at(degrees, 2.55));
}
