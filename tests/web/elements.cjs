// So much of a browser that panels are made in Node: elements with children and listeners, plots that keep what they are
// given; no frame is ever drawn.
class Node {
  constructor(tag) { Object.assign(this, { tag, children: [], listeners: {}, style: {} }); }
  setAttribute() {}
  setPointerCapture() {}
  getPropertyValue() { return "#000000"; }
  replaceChildren(...children) { this.children = children; }
  addEventListener(name, act) { (this.listeners[name] ??= []).push(act); }
  tell(name, event) { for (const act of this.listeners[name]) act(event); }
  all(tag) { return [...(this.tag === tag ? [this] : []), ...this.children.flatMap((one) => one.all?.(tag) ?? [])]; }
}
class uPlot {
  static plots = [];
  constructor(options, data) {
    this.over = new Node("div");
    uPlot.plots.push(data);
  }
}
Object.assign(globalThis, {
  Node, uPlot,
  document: { createElement: (tag) => new Node(tag) },
  getComputedStyle: () => new Node(),
  requestAnimationFrame: () => {},
  ResizeObserver: class { observe() {} },
});
