/** The heading dial: the true heading, the estimates, and their stated three sigma. */

import { quarters, sharpCanvas, stroked } from "./canvas.js";
import { fixed } from "./numbers.js";
import { colour, faint, groupColour } from "./theme.js";

/** @typedef {{group: number, heading: number, sigma: number | null}} Needle  deg */

export function headingDial() {
  const canvas = sharpCanvas({ class: "dial", role: "img", "aria-label": "Heading dial" }, () => shown && draw(...shown));
  /** @type {[number, Needle[]] | undefined} */
  let shown;
  /** @param {number} truth  deg
   * @param {Needle[]} needles */
  const draw = (truth, needles) => {
    shown = [truth, needles];
    const context = canvas.cleared();
    const [width, height] = canvas.size;
    const radius = Math.min(width, height) / 2 - 18;
    context.translate(width / 2, height / 2);
    face(context, radius);
    for (const { group, heading, sigma } of needles) {
      if (sigma === null || !(sigma > 0)) continue;
      const half = Math.min(180, 3 * sigma);
      context.fillStyle = faint(groupColour(group), 0.16);
      context.beginPath();
      context.moveTo(0, 0);
      context.arc(0, 0, radius - 4, radians(heading - half) - Math.PI / 2, radians(heading + half) - Math.PI / 2);
      context.fill();
    }
    context.lineCap = "round";
    stroked(context, colour("truth"), 6, [[0, 0], towards(truth, radius - 10)]);
    for (const { group, heading } of needles) stroked(context, groupColour(group), 2, [[0, 0], towards(heading, radius - 6)]);
    context.fillStyle = colour("ink");
    context.font = "600 17px system-ui, sans-serif";
    context.textAlign = "center";
    context.fillText(`${fixed((truth + 360) % 360, 1)}\u00b0`, 0, Math.cos(radians(truth)) > 0 ? radius * 0.5 : -radius * 0.42);
  };
  return { element: canvas.element, draw };
}

/** From the middle in a direction, px.
 * @param {number} degrees
 * @param {number} radius */
function towards(degrees, radius) {
  return [radius * Math.sin(radians(degrees)), -radius * Math.cos(radians(degrees))];
}

/** @param {number} degrees */
function radians(degrees) {
  return (degrees * Math.PI) / 180;
}

/** @param {CanvasRenderingContext2D} context
 * @param {number} radius */
function face(context, radius) {
  context.strokeStyle = colour("rule");
  context.lineWidth = 1;
  context.beginPath();
  context.arc(0, 0, radius, 0, 2 * Math.PI);
  context.stroke();
  const mark = (/** @type {number} */ degrees) => [towards(degrees, radius), towards(degrees, radius - (degrees % 30 ? 4 : 8))];
  stroked(context, colour("muted"), 1, ...Array.from({ length: 36 }, (_, k) => mark(10 * k)));
  quarters(context, (degrees) => towards(degrees, radius + 10));
}
