/** Unpacks a page: its documents, its worker and its script stand deflated in the element `packed`. */

(async () => {
  const packed = /** @type {HTMLElement} */ (document.getElementById("packed"));
  try {
    const bytes = Uint8Array.from(atob(packed.textContent ?? ""), (one) => one.charCodeAt(0));
    const stream = new Blob([bytes]).stream().pipeThrough(new DecompressionStream("gzip"));
    for (const { id, type, text } of await new Response(stream).json()) {
      const script = Object.assign(document.createElement("script"), { id, type, textContent: text });
      packed.before(script);
    }
  } catch (error) {
    packed.before(`This page cannot be unpacked: ${error instanceof Error ? error.message : error}. It needs a browser of 2023 or later.`);
  }
  packed.remove();
})();
