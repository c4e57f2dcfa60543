/** The track seen from above, north up, on a grid of 1, 2 or 5 times a power of ten metres: zoom by wheel, pinch and keys. */

import { dragged, sharpCanvas, stroked } from "./canvas.js";
import { button, h, onceAFrame, panelOf, zoomKeys } from "./dom.js";
import { minus, number, roundDown, tick } from "./numbers.js";
import { colour, faint, groupColour, onTheme } from "./theme.js";

/**
 * @typedef {object} Line
 * @property {number} group
 * @property {ArrayLike<number>} east  m
 * @property {ArrayLike<number>} north  m
 *
 * @typedef {{group: number, east: number, north: number, place?: number}} Fix  place: of the record that it is shown from
 *
 * @typedef {object} Scene
 * @property {Line[]} lines
 * @property {Line[]} [last]  of the last run
 * @property {{group: number, centre: number[], radii: number[]}[]} [ellipses]  what estimates state, east and north
 * @property {boolean} [cut]  whether there is no GNSS now
 * @property {Fix[]} refused  fixes refused
 * @property {Fix[]} [accepted]  fixes used
 * @property {[number, number]} places  first place drawn, and the one after the last
 */

const CLOSER = 12; // times larger than all of the first line, when the map begins to follow
const NEAREST = 20; // m: what it shows at least, also before the vehicle moves
const KEYS = "Press plus and minus to zoom, arrow keys to move, 0 for the whole track.";

/**
 * @param {string} title
 * @param {Scene} scene
 * @param {string} label  what a screen reader tells
 * @param {boolean} [moving]  whether the track grows: the map can follow the end of its first line
 */
export function trackPlot(title, scene, label, moving = false) {
  const sharp = sharpCanvas(
    { role: "img", tabindex: "0", class: "track", "aria-label": `${title}. ${label} ${KEYS}` },
    () => draw(),
  );
  const { element: canvas, size } = sharp;
  const readout = h("output", { class: "readout" });
  const follow = button("Follow", () => setFollowing(!following), { class: "quiet follow", id: "follow", "aria-pressed": "false" });
  const element = panelOf("tall", title, "m", [readout, moving && follow], canvas);
  /** @type {Set<number>} */
  const hidden = new Set();
  /** @type {{east: number, north: number, scale: number} | null} */
  let view = null;
  let following = false;
  const now = () => {
    if (following && view) Object.assign(view, endOf(scene));
    paint(sharp.cleared(), size, scene, hidden, view ?? fitted(scene, size, hidden));
  };
  const draw = onceAFrame(now);
  const followed = (/** @type {boolean} */ on) => {
    following = on;
    follow.setAttribute("aria-pressed", String(on));
  };
  const setFollowing = (/** @type {boolean} */ on) => {
    const first = { ...scene, lines: scene.lines.slice(0, 1) };
    if (on && !view) view = { ...endOf(scene), scale: Math.min(CLOSER * fitted(first, size, new Set()).scale, size[0] / NEAREST) };
    followed(on);
    if (on) draw();
    else if (view) reset();
  };
  const change = (/** @type {(view: {east: number, north: number, scale: number}) => void} */ act) => {
    view = view ?? { ...fitted(scene, size, hidden) };
    act(view);
    draw();
  };
  const zoom = (/** @type {number} */ factor) => change((now) => (now.scale *= factor));
  const move = (/** @type {number} */ right, /** @type {number} */ up) => {
    followed(false);
    change((now) => {
      now.east += right / now.scale;
      now.north += up / now.scale;
    });
  };
  const reset = () => {
    view = null;
    followed(false);
    draw();
  };
  const over = (/** @type {number} */ x, /** @type {number} */ y) => {
    const now = view ?? fitted(scene, size, hidden);
    const [east, north] = [now.east + (x - size[0] / 2) / now.scale, now.north - (y - size[1] / 2) / now.scale];
    readout.textContent = Number.isFinite(x) ? `east ${minus(number(east))}  north ${minus(number(north))}` : "";
  };
  canvas.addEventListener("pointermove", (/** @type {PointerEvent} */ event) => over(event.offsetX, event.offsetY));
  canvas.addEventListener("pointerleave", () => over(NaN, NaN));
  dragged(canvas, move, zoom);
  const wheel = (/** @type {WheelEvent} */ event) => {
    if (!event.ctrlKey && document.activeElement !== canvas) return;
    event.preventDefault();
    zoom(Math.exp(-event.deltaY / 400));
  };
  canvas.addEventListener("wheel", wheel, { passive: false });
  canvas.addEventListener("dblclick", reset);
  const arrows = {
    ArrowLeft: () => move(-40, 0),
    ArrowRight: () => move(40, 0),
    ArrowUp: () => move(0, 40),
    ArrowDown: () => move(0, -40),
  };
  canvas.addEventListener("keydown", zoomKeys(() => zoom(1.5), () => zoom(1 / 1.5), reset, arrows));
  onTheme(now); // at once: for paper there is no further frame
  return {
    element,
    show: (/** @type {number} */ group, /** @type {boolean} */ shown) => {
      if (shown) hidden.delete(group);
      else hidden.add(group);
      draw();
    },
    update: (/** @type {Scene} */ now) => {
      scene = now;
      draw();
    },
    draw,
  };
}

/** Where the first line ends.
 * @param {Scene} scene */
function endOf({ lines: [{ east, north }], places }) {
  const last = Math.min(places[1], east.length) - 1;
  return { east: east[last] ?? 0, north: north[last] ?? 0 };
}

/** The view that shows all.
 * @param {Scene} scene
 * @param {number[]} size
 * @param {Set<number>} hidden */
function fitted(scene, size, hidden) {
  let [west, east, south, north] = [Infinity, -Infinity, Infinity, -Infinity];
  for (const line of scene.lines) {
    if (hidden.has(line.group)) continue;
    const [first, after] = scene.places;
    for (let place = first; place < Math.min(after, line.east.length); place++) {
      const [x, y] = [line.east[place], line.north[place]];
      if (!(Number.isFinite(x) && Number.isFinite(y))) continue;
      west = Math.min(west, x);
      east = Math.max(east, x);
      south = Math.min(south, y);
      north = Math.max(north, y);
    }
  }
  if (west > east) return { east: 0, north: 0, scale: 1 };
  const scale = Math.min((size[0] - 70) / Math.max(east - west, 0.1), (size[1] - 60) / Math.max(north - south, 0.1));
  return { east: (west + east) / 2, north: (south + north) / 2, scale };
}

/** @param {CanvasRenderingContext2D} context
 * @param {number[]} size
 * @param {Scene} scene
 * @param {Set<number>} hidden
 * @param {{east: number, north: number, scale: number}} view */
function paint(context, size, scene, hidden, view) {
  const [width, height] = size;
  const x = (/** @type {number} */ east) => width / 2 + (east - view.east) * view.scale;
  const y = (/** @type {number} */ north) => height / 2 - (north - view.north) * view.scale;
  if (scene.cut) {
    context.fillStyle = colour("outage");
    context.fillRect(0, 0, width, height);
  }
  grid(context, size, view, x, y);
  if (scene.cut) {
    context.fillStyle = colour("bad");
    context.font = "bold 14px system-ui, sans-serif";
    context.fillText("no GNSS", 12, 22);
  }
  context.lineJoin = "round";
  const [first, after] = scene.places;
  for (const line of scene.lines) {
    if (hidden.has(line.group)) continue;
    context.strokeStyle = groupColour(line.group);
    context.lineWidth = line.group >= 0 ? 1.4 : scene.lines.length > 1 ? 4 : 1.6;
    context.beginPath();
    let pen = false;
    for (let place = first; place < Math.min(after, line.east.length); place++) {
      const [east, north] = [line.east[place], line.north[place]];
      if (!(Number.isFinite(east) && Number.isFinite(north))) {
        pen = false;
        continue;
      }
      if (pen) context.lineTo(x(east), y(north));
      else context.moveTo(x(east), y(north));
      pen = true;
    }
    context.stroke();
  }
  for (const { group, east, north } of scene.last ?? []) {
    if (hidden.has(group)) continue;
    stroked(context, faint(groupColour(group), 0.6), 0.7, Array.from(east, (one, place) => [x(one), y(north[place])]));
  }
  for (const { group, centre, radii } of scene.ellipses ?? []) {
    if (hidden.has(group) || !radii.every(Number.isFinite)) continue;
    context.beginPath();
    context.ellipse(x(centre[0]), y(centre[1]), radii[0] * view.scale, radii[1] * view.scale, 0, 0, 2 * Math.PI);
    context.fillStyle = faint(groupColour(group), 0.16);
    context.fill();
    context.strokeStyle = groupColour(group);
    context.lineWidth = 1;
    context.stroke();
  }
  const past = (/** @type {Fix} */ fix) => (fix.place ?? 0) < after;
  context.fillStyle = colour("fix");
  for (const fix of (scene.accepted ?? []).filter(past)) context.fillRect(x(fix.east) - 1, y(fix.north) - 1, 2, 2);
  for (const fix of scene.refused.filter(past)) {
    if (hidden.has(fix.group)) continue;
    const [a, b] = [x(fix.east), y(fix.north)];
    const bars = [1, -1].map((sign) => [[a - 3.5, b - 3.5 * sign], [a + 3.5, b + 3.5 * sign]]);
    stroked(context, groupColour(fix.group), 1.5, ...bars);
  }
  ends(context, scene, hidden, x, y);
}

/** The start of the first line, and where each line is now.
 * @param {CanvasRenderingContext2D} context
 * @param {Scene} scene
 * @param {Set<number>} hidden
 * @param {(east: number) => number} x
 * @param {(north: number) => number} y */
function ends(context, scene, hidden, x, y) {
  /** @type {(line: Line, place: number, radius: number, fill: string, edge: string) => void} */
  const disc = ({ east, north }, place, radius, fill, edge) => {
    context.beginPath();
    context.arc(x(east[place]), y(north[place]), radius, 0, 2 * Math.PI);
    context.fillStyle = fill;
    context.fill();
    context.strokeStyle = edge;
    context.lineWidth = 1.5;
    context.stroke();
  };
  const begun = scene.lines[0];
  if (begun?.east.length && Number.isFinite(begun.east[0])) disc(begun, 0, 4, colour("surface"), colour("ink"));
  for (const line of scene.lines) {
    const last = Math.min(scene.places[1], line.east.length) - 1;
    if (hidden.has(line.group) || last < 0) continue;
    disc(line, last, line.group < 0 ? 4 : 3, groupColour(line.group), colour("surface"));
  }
}

/** @param {CanvasRenderingContext2D} context
 * @param {number[]} size
 * @param {{east: number, north: number, scale: number}} view
 * @param {(east: number) => number} x
 * @param {(north: number) => number} y */
function grid(context, [width, height], view, x, y) {
  const step = roundDown(110 / view.scale);
  const [west, south] = [view.east - width / 2 / view.scale, view.north - height / 2 / view.scale];
  const sharp = (/** @type {number} */ place) => Math.round(place) + 0.5;
  /** @type {number[][][]} */
  const lines = [];
  for (let at = Math.ceil(west / step); at * step < west + width / view.scale; at++)
    lines.push([[sharp(x(at * step)), 0], [sharp(x(at * step)), height]]);
  for (let at = Math.ceil(south / step); at * step < south + height / view.scale; at++)
    lines.push([[0, sharp(y(at * step))], [width, sharp(y(at * step))]]);
  stroked(context, colour("grid"), 1, ...lines);
  const [left, end, low] = [12, 12 + step * view.scale, height - 11];
  stroked(context, colour("muted"), 1.5, [[left, low - 5], [left, low], [end, low], [end, low - 5]]);
  context.fillStyle = colour("muted");
  context.font = "11.5px system-ui, sans-serif";
  context.fillText(
    step >= 1000 ? `${tick(step / 1000)} km` : step >= 1 ? `${tick(step)} m` : `${tick(step * 100)} cm`,
    17,
    height - 17,
  );
  const [right, top] = [width - 18, 14];
  const arrow = [[right - 3.5, top + 5], [right, top], [right + 3.5, top + 5]];
  stroked(context, colour("muted"), 1.5, [[right, top + 14], [right, top]], arrow);
  context.fillText("N", right - 4, top + 27);
}
