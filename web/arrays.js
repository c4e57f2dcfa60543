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

/** Float64 numbers of a text in base64.
 * @param {string} text
 * @returns {Float64Array} */
export function numbersOf(text) {
  return new Float64Array(bytesOf(text).slice().buffer);
}

/** What a stream makes of bytes: packs or unpacks them.
 * @param {BlobPart} bytes
 * @param {CompressionStream | DecompressionStream} stream */
export async function piped(bytes, stream) {
  const made = new Blob([bytes]).stream().pipeThrough(/** @type {any} */ (stream));
  return new Uint8Array(await new Response(made).arrayBuffer());
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
