/**
 * Elements of the page.
 *
 * @typedef {Node | string | number | null | undefined | false} Child
 */

/**
 * An element with attributes and children. An attribute `on...` is a listener; one that is `false` or null is left out.
 * @param {string} tag
 * @param {Record<string, any>} [attributes]
 * @param {...(Child | Child[])} children
 * @returns {any}
 */
export function h(tag, attributes = {}, ...children) {
  const element = document.createElement(tag);
  for (const [name, value] of Object.entries(attributes)) {
    if (value === false || value === null || value === undefined) continue;
    if (name.startsWith("on")) element.addEventListener(name.slice(2), value);
    else element.setAttribute(name, value === true ? "" : String(value));
  }
  fill(element, ...children.flat());
  return element;
}

/** Replace the children of an element.
 * @param {Element} element
 * @param {...Child} children */
export function fill(element, ...children) {
  const some = children.filter((child) => child || child === 0);
  element.replaceChildren(...some.map((child) => (child instanceof Node ? child : String(child))));
}

/** A panel with its title, the unit of what it shows, and what stands beside them.
 * @param {string} kind  further classes
 * @param {string} title
 * @param {string} unit  "1" or empty: none
 * @param {Child | Child[]} beside
 * @param {...Child} children */
export function panelOf(kind, title, unit, beside, ...children) {
  const shown = unit !== "" && unit !== "1" && h("span", { class: "unit" }, ` ${unit}`);
  return h("div", { class: `panel${kind && ` ${kind}`}` }, h("div", { class: "head" }, h("h3", {}, title, shown), beside), children);
}

/** A section of panels beside each other.
 * @param {{title: string, columns: number, note?: string}} section
 * @param {HTMLElement[]} panels */
export function sectionOf({ title, columns, note }, panels) {
  return h("section", {}, h("h2", {}, title), note && h("p", { class: "quiet" }, note), h("div", { class: `panels of-${columns}` }, panels));
}

/** The JSON document of a kind that this page holds, or null.
 * @param {string} kind
 * @returns {any} */
export function embedded(kind) {
  const element = document.getElementById(kind);
  return element ? JSON.parse(element.textContent ?? "null") : null;
}

/** A button.
 * @param {string} text
 * @param {() => void} act
 * @param {Record<string, any>} [attributes] */
export function button(text, act, attributes = {}) {
  return h("button", { type: "button", onclick: act, ...attributes }, text);
}

/** What keys do, alone, as a listener: zoom, show all, and others by name.
 * @param {() => void} closer
 * @param {() => void} farther
 * @param {() => void} all
 * @param {Record<string, () => void>} others */
export function zoomKeys(closer, farther, all, others) {
  /** @type {Record<string, () => void>} */
  const acts = { "+": closer, "=": closer, "-": farther, 0: all, Escape: all, ...others };
  return (/** @type {KeyboardEvent} */ event) => {
    if (!acts[event.key] || chorded(event)) return;
    event.preventDefault();
    acts[event.key]();
  };
}

/** Whether a key is pressed with one that gives it another meaning.
 * @param {KeyboardEvent} event */
export function chorded(event) {
  return event.ctrlKey || event.metaKey || event.altKey;
}

/** Call `act` at most once a frame, however often it is asked for.
 * @param {() => void} act
 * @returns {() => void} */
export function onceAFrame(act) {
  let asked = false;
  return () => {
    if (asked) return;
    asked = true;
    requestAnimationFrame(() => {
      asked = false;
      act();
    });
  };
}
