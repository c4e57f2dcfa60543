/** A canvas with the pixels of the screen, and lines on it. */

import { h } from "./dom.js";
import { colour } from "./theme.js";

/**
 * @param {Record<string, any>} attributes
 * @param {() => void} [resized]  draw again
 */
export function sharpCanvas(attributes, resized = () => {}) {
  /** @type {HTMLCanvasElement} */
  const element = h("canvas", attributes);
  const size = [300, 240];
  new ResizeObserver(() => {
    if (!element.clientWidth || !element.clientHeight) return; // it is not shown
    [size[0], size[1]] = [element.clientWidth, element.clientHeight];
    element.width = Math.round(size[0] * devicePixelRatio);
    element.height = Math.round(size[1] * devicePixelRatio);
    resized();
  }).observe(element);
  return {
    element,
    /** Width and height in pixels of the page, which change with the element. */
    size,
    /** Its cleared context, in pixels of the page from the upper left corner. */
    cleared: () => {
      const context = /** @type {CanvasRenderingContext2D} */ (element.getContext("2d"));
      context.setTransform(devicePixelRatio, 0, 0, devicePixelRatio, 0, 0);
      context.clearRect(0, 0, size[0], size[1]);
      return context;
    },
  };
}

/** Act on drags over a canvas.
 * @param {HTMLCanvasElement} canvas
 * @param {(right: number, up: number) => void} move  px, against a pointer that is down
 * @param {(factor: number) => void} [zoom]  while two are down, which move apart */
export function dragged(canvas, move, zoom = () => {}) {
  /** @type {Map<number, [number, number]>} */
  const down = new Map();
  const apart = () => {
    const [a, b] = [...down.values()];
    return Math.hypot(a[0] - b[0], a[1] - b[1]);
  };
  canvas.addEventListener("pointerdown", (event) => {
    down.set(event.pointerId, [event.offsetX, event.offsetY]);
    canvas.setPointerCapture(event.pointerId);
  });
  canvas.addEventListener("pointermove", (event) => {
    const before = down.get(event.pointerId);
    if (!before) return;
    const gap = down.size === 2 ? apart() : 0;
    down.set(event.pointerId, [event.offsetX, event.offsetY]);
    if (down.size === 2) zoom(apart() / Math.max(1, gap));
    else move(before[0] - event.offsetX, event.offsetY - before[1]);
  });
  for (const name of ["pointerup", "pointercancel"]) {
    canvas.addEventListener(name, (event) => down.delete(/** @type {PointerEvent} */ (event).pointerId));
  }
}

/** Begin a path of lines through points.
 * @param {CanvasRenderingContext2D} context
 * @param {...number[][]} lines  x, y of each point */
export function traced(context, ...lines) {
  context.beginPath();
  for (const line of lines) line.forEach(([x, y], place) => (place ? context.lineTo(x, y) : context.moveTo(x, y)));
}

/** Draw lines through points.
 * @param {CanvasRenderingContext2D} context
 * @param {string} paint
 * @param {number} width
 * @param {...number[][]} lines */
export function stroked(context, paint, width, ...lines) {
  context.strokeStyle = paint;
  context.lineWidth = width;
  traced(context, ...lines);
  context.stroke();
}

/** Letters N, E, S and W at their places.
 * @param {CanvasRenderingContext2D} context
 * @param {(degrees: number) => number[]} place  x, y */
export function quarters(context, place) {
  context.fillStyle = colour("muted");
  context.font = "12px system-ui, sans-serif";
  context.textAlign = "center";
  context.textBaseline = "middle";
  ["N", "E", "S", "W"].forEach((letter, k) => context.fillText(letter, place(90 * k)[0], place(90 * k)[1]));
}
