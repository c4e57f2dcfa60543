/** The channels of errors: how they are called in tables and in plots. */

export const LABELS = {
  roll_deg: "roll [deg]",
  pitch_deg: "pitch [deg]",
  heading_deg: "heading [deg]",
  north_m: "north [m]",
  east_m: "east [m]",
  down_m: "down [m]",
  vn_mps: "vn [m/s]",
  ve_mps: "ve [m/s]",
  vd_mps: "vd [m/s]",
};
const NAMES = {
  roll_deg: ["Roll error", "deg"],
  pitch_deg: ["Pitch error", "deg"],
  heading_deg: ["Heading error", "deg"],
  north_m: ["North error", "m"],
  east_m: ["East error", "m"],
  down_m: ["Down error", "m"],
  vn_mps: ["Velocity north error", "m/s"],
  ve_mps: ["Velocity east error", "m/s"],
  vd_mps: ["Velocity down error", "m/s"],
};

/** The title and unit of a channel of errors.
 * @param {string} channel */
export function channelName(channel) {
  return NAMES[/** @type {keyof typeof NAMES} */ (channel)] ?? [channel, ""];
}
