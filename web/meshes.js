/** Shapes of vehicles as faces of corners in b (forward, right, down), about two units long. */

/** @typedef {[number, number, number]} Vector */

/** An outline that is as wide to the left as to the right.
 * @param {...Vector} right  its corners there, in order; those in the middle first or last
 * @returns {Vector[]} */
function mirrored(...right) {
  return [...right, ...right.filter(([, y]) => y !== 0).reverse().map(opposite)];
}

/** A corner on the other side.
 * @param {Vector} corner
 * @returns {Vector} */
function opposite([x, y, z]) {
  return [x, -y, z];
}

/** A regular outline about a point, from two vectors to its sides.
 * @param {number} corners
 * @param {Vector} centre
 * @param {Vector} one
 * @param {Vector} two
 * @returns {Vector[]} */
function round(corners, centre, one, two) {
  return Array.from({ length: corners }, (_, k) => {
    const angle = (2 * Math.PI * k) / corners;
    const part = (/** @type {number} */ axis) => centre[axis] + one[axis] * Math.cos(angle) + two[axis] * Math.sin(angle);
    return [part(0), part(1), part(2)];
  });
}

/** The faces between two outlines of as many corners, with both ends closed.
 * @param {Vector[]} one
 * @param {Vector[]} other
 * @returns {Vector[][]} */
function between(one, other) {
  const sides = one.map((corner, place) => {
    const next = (place + 1) % one.length;
    return [corner, one[next], other[next], other[place]];
  });
  return [...sides, one, other];
}

/** A box between two corners.
 * @param {Vector} low
 * @param {Vector} high
 * @returns {Vector[][]} */
function box([x, y, z], [X, Y, Z]) {
  /** @returns {Vector[]} */
  const outline = (/** @type {number} */ down) => [[x, y, down], [X, y, down], [X, Y, down], [x, Y, down]];
  return between(outline(z), outline(Z));
}

/** @returns {Vector[][]} */
function ship() {
  const deck = mirrored([1.7, 0, -0.12], [1.1, 0.36, -0.08], [-1.3, 0.42, -0.05], [-1.5, 0.34, -0.05]);
  const keel = mirrored([1.35, 0, 0.42], [0.9, 0.16, 0.45], [-1.2, 0.24, 0.45], [-1.35, 0.16, 0.42]);
  return [
    ...between(deck, keel),
    ...box([-1.15, -0.26, -0.42], [-0.45, 0.26, -0.06]),
    ...box([-0.75, -0.2, -0.66], [-0.5, 0.2, -0.42]),
    ...box([-1.05, -0.09, -0.75], [-0.88, 0.09, -0.42]),
  ];
}

/** @returns {Vector[][]} */
function car() {
  const low = mirrored([0.6, 0.52, -0.08], [-1.05, 0.52, -0.1]);
  const roof = mirrored([0.15, 0.42, -0.46], [-0.75, 0.42, -0.46]);
  const rim = (/** @type {number} */ x, /** @type {number} */ y) => round(12, [x, y, 0.3], [0.24, 0, 0], [0, 0, 0.24]);
  const wheels = [0.85, -0.8].flatMap((x) => [-0.58, 0.44].flatMap((y) => between(rim(x, y), rim(x, y + 0.14))));
  return [...wheels, ...box([-1.3, -0.55, -0.1], [1.3, 0.55, 0.32]), ...between(low, roof)];
}

/** @returns {Vector[][]} */
function aircraft() {
  const ring = (/** @type {number} */ x, /** @type {number} */ r) => round(6, [x, 0, 0], [0, r, 0], [0, 0, r]);
  /** @type {Vector[]} */
  const wing = [[0.55, 0.1, 0.05], [0.05, 1.75, -0.03], [-0.3, 1.75, -0.03], [-0.3, 0.1, 0.05]];
  /** @type {Vector[]} */
  const tailplane = [[-1.05, 0.03, -0.05], [-1.3, 0.62, -0.05], [-1.5, 0.62, -0.05], [-1.42, 0.03, -0.05]];
  /** @type {Vector[]} */
  const fin = [[-0.95, 0, -0.1], [-1.35, 0, -0.62], [-1.55, 0, -0.62], [-1.42, 0, -0.05]];
  return [
    ...between(ring(1.5, 0.05), ring(1.1, 0.17)),
    ...between(ring(1.1, 0.17), ring(-0.4, 0.18)),
    ...between(ring(-0.4, 0.18), ring(-1.4, 0.05)),
    ...[wing, tailplane].flatMap((one) => [one, one.map(opposite)]),
    fin,
  ];
}

/** @returns {Vector[][]} */
function multirotor() {
  const arms = [1, -1].flatMap((x) =>
    [1, -1].flatMap((y) => {
      const [a, b] = [0.85 * x, 0.85 * y];
      /** @type {Vector[]} */
      const arm = [[0.2 * x, 0.12 * y, -0.02], [a, b, -0.1], [a + 0.05, b - 0.05, -0.1], [0.25 * x, 0.07 * y, -0.02]];
      return [arm, round(12, [a, b, -0.16], [0.42, 0, 0], [0, 0.42, 0])];
    }),
  );
  return [...box([-0.3, -0.22, -0.12], [0.38, 0.22, 0.12]), ...arms];
}

/** A box with an arrow forward, for a turntable or a vehicle of another package.
 * @returns {Vector[][]} */
function plain() {
  return [...box([-0.9, -0.6, -0.25], [0.7, 0.6, 0.25]), mirrored([1.3, 0, 0], [0.7, 0.35, 0])];
}

/** The faces of a vehicle's shape.
 * @param {string} shape  of its kind's traits
 * @returns {Vector[][]} */
export function meshOf(shape) {
  const shapes = { ship, car, aircraft, multirotor };
  return shape in shapes ? shapes[/** @type {keyof typeof shapes} */ (shape)]() : plain();
}
