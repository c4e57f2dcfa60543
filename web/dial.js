/** The heading dial: the true heading, the estimates, and their stated three sigma. */

import { sharpCanvas } from "./canvas.js";
import { fixed } from "./numbers.js";
import { colour, faint, groupColour } from "./theme.js";

/** @typedef {{group: number, heading: number, sigma: number | null}} Needle  deg */

export function headingDial() {
  const canvas = sharpCanvas(
    { class: "dial", role: "img", "aria-label": "Heading dial" },
    () => shown && draw(...shown),
  );
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
    needle(context, truth, radius - 10, 6, colour("truth"));
    for (const { group, heading } of needles) needle(context, heading, radius - 6, 2, groupColour(group));
    context.fillStyle = colour("ink");
    context.font = "600 17px system-ui, sans-serif";
    context.textAlign = "center";
    context.fillText(`${fixed((truth + 360) % 360, 1)}\u00b0`, 0, Math.cos(radians(truth)) > 0 ? radius * 0.5 : -radius * 0.42);
  };
  return { element: canvas.element, draw };
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
  context.strokeStyle = colour("muted");
  context.beginPath();
  for (let degrees = 0; degrees < 360; degrees += 10) {
    const [s, c] = [Math.sin(radians(degrees)), -Math.cos(radians(degrees))];
    const inner = radius - (degrees % 30 ? 4 : 8);
    context.moveTo(radius * s, radius * c);
    context.lineTo(inner * s, inner * c);
  }
  context.stroke();
  context.fillStyle = colour("muted");
  context.font = "12px system-ui, sans-serif";
  context.textAlign = "center";
  context.textBaseline = "middle";
  ["N", "E", "S", "W"].forEach((letter, place) => {
    const angle = (place * Math.PI) / 2;
    context.fillText(letter, (radius + 10) * Math.sin(angle), -(radius + 10) * Math.cos(angle));
  });
}

/** @param {CanvasRenderingContext2D} context
 * @param {number} degrees
 * @param {number} length
 * @param {number} width
 * @param {string} paint */
function needle(context, degrees, length, width, paint) {
  const [s, c] = [Math.sin(radians(degrees)), -Math.cos(radians(degrees))];
  context.strokeStyle = paint;
  context.lineWidth = width;
  context.beginPath();
  context.moveTo(0, 0);
  context.lineTo(length * s, length * c);
  context.stroke();
}
