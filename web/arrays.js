/** Arrays of a document: little-endian single precision in base64. */

/** The bytes of a text in base64.
 * @param {string} text
 * @returns {Uint8Array<ArrayBuffer>} */
export function bytesOf(text) {
  const direct = /** @type {any} */ (Uint8Array).fromBase64;
  if (direct) return direct.call(Uint8Array, text);
  const raw = atob(text);
  const bytes = new Uint8Array(raw.length);
  for (let place = 0; place < raw.length; place++) bytes[place] = raw.charCodeAt(place);
  return bytes;
}

/** Bytes as a text in base64.
 * @param {Uint8Array} bytes
 * @returns {string} */
export function textOf(bytes) {
  return btoa(Array.from(bytes, (byte) => String.fromCharCode(byte)).join(""));
}

/** The arrays of a document by number, decoded when they are first asked for.
 * @param {string[]} texts
 * @returns {(place: number) => Float32Array} */
export function arraysOf(texts) {
  /** @type {Map<number, Float32Array>} */
  const decoded = new Map();
  return (place) => {
    let found = decoded.get(place);
    if (!found) {
      found = new Float32Array(bytesOf(texts[place]).slice().buffer);
      decoded.set(place, found);
    }
    return found;
  };
}

/** Values for a plot: null where there is none.
 * @param {ArrayLike<number>} values
 * @returns {(number | null)[]} */
export function drawn(values) {
  return Array.from(values, (value) => (Number.isFinite(value) ? value : null));
}
