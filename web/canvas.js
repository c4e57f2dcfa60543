/** A canvas with the pixels of the screen. */

import { h } from "./dom.js";

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
