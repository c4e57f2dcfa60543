/** Shapes of vehicles as faces of corners in b (forward, right, down), about two units long. */

/** @typedef {[number, number, number]} Vector */

/** A box between two corners.
 * @param {Vector} low
 * @param {Vector} high
 * @returns {Vector[][]} */
function box([x, y, z], [X, Y, Z]) {
  return [
    [
      [x, y, z],
      [X, y, z],
      [X, Y, z],
      [x, Y, z],
    ],
    [
      [x, y, Z],
      [X, y, Z],
      [X, Y, Z],
      [x, Y, Z],
    ],
    [
      [x, y, z],
      [X, y, z],
      [X, y, Z],
      [x, y, Z],
    ],
    [
      [x, Y, z],
      [X, Y, z],
      [X, Y, Z],
      [x, Y, Z],
    ],
    [
      [x, y, z],
      [x, Y, z],
      [x, Y, Z],
      [x, y, Z],
    ],
    [
      [X, y, z],
      [X, Y, z],
      [X, Y, Z],
      [X, y, Z],
    ],
  ];
}

/** The faces between two outlines of as many corners, with both ends closed.
 * @param {Vector[]} one
 * @param {Vector[]} other
 * @returns {Vector[][]} */
function between(one, other) {
  const sides = one.map((corner, place) => {
    const next = (place + 1) % one.length;
    return /** @type {Vector[]} */ ([corner, one[next], other[next], other[place]]);
  });
  return [...sides, one, other];
}

/** @returns {Vector[][]} */
function ship() {
  const deck = /** @type {Vector[]} */ ([
    [1.7, 0, -0.12],
    [1.1, 0.36, -0.08],
    [-1.3, 0.42, -0.05],
    [-1.5, 0.34, -0.05],
    [-1.5, -0.34, -0.05],
    [-1.3, -0.42, -0.05],
    [1.1, -0.36, -0.08],
  ]);
  const keel = /** @type {Vector[]} */ ([
    [1.35, 0, 0.42],
    [0.9, 0.16, 0.45],
    [-1.2, 0.24, 0.45],
    [-1.35, 0.16, 0.42],
    [-1.35, -0.16, 0.42],
    [-1.2, -0.24, 0.45],
    [0.9, -0.16, 0.45],
  ]);
  return [
    ...between(deck, keel),
    ...box([-1.15, -0.26, -0.42], [-0.45, 0.26, -0.06]),
    ...box([-0.75, -0.2, -0.66], [-0.5, 0.2, -0.42]),
    ...box([-1.05, -0.09, -0.75], [-0.88, 0.09, -0.42]),
  ];
}

/** @returns {Vector[][]} */
function car() {
  const low = /** @type {Vector[]} */ ([
    [0.6, -0.52, -0.08],
    [0.6, 0.52, -0.08],
    [-1.05, 0.52, -0.1],
    [-1.05, -0.52, -0.1],
  ]);
  const roof = /** @type {Vector[]} */ ([
    [0.15, -0.42, -0.46],
    [0.15, 0.42, -0.46],
    [-0.75, 0.42, -0.46],
    [-0.75, -0.42, -0.46],
  ]);
  const rim = (/** @type {number} */ x, /** @type {number} */ y) =>
    Array.from({ length: 12 }, (_, k) => {
      const angle = (k * Math.PI) / 6;
      return /** @type {Vector} */ ([x + 0.24 * Math.cos(angle), y, 0.3 + 0.24 * Math.sin(angle)]);
    });
  const wheels = [0.85, -0.8].flatMap((x) => [-0.58, 0.44].flatMap((y) => between(rim(x, y), rim(x, y + 0.14))));
  return [...wheels, ...box([-1.3, -0.55, -0.1], [1.3, 0.55, 0.32]), ...between(low, roof)];
}

/** @returns {Vector[][]} */
function aircraft() {
  const [nose, tail] = [1.5, -1.4];
  const ring = (/** @type {number} */ x, /** @type {number} */ r) =>
    /** @type {Vector[]} */ (
      Array.from({ length: 6 }, (_, k) => [x, r * Math.cos((k * Math.PI) / 3), r * Math.sin((k * Math.PI) / 3)])
    );
  return [
    ...between(ring(nose, 0.05), ring(1.1, 0.17)),
    ...between(ring(1.1, 0.17), ring(-0.4, 0.18)),
    ...between(ring(-0.4, 0.18), ring(tail, 0.05)),
    [
      [0.55, 0.1, 0.05],
      [0.05, 1.75, -0.03],
      [-0.3, 1.75, -0.03],
      [-0.3, 0.1, 0.05],
    ],
    [
      [0.55, -0.1, 0.05],
      [0.05, -1.75, -0.03],
      [-0.3, -1.75, -0.03],
      [-0.3, -0.1, 0.05],
    ],
    [
      [-1.05, 0.03, -0.05],
      [-1.3, 0.62, -0.05],
      [-1.5, 0.62, -0.05],
      [-1.42, 0.03, -0.05],
    ],
    [
      [-1.05, -0.03, -0.05],
      [-1.3, -0.62, -0.05],
      [-1.5, -0.62, -0.05],
      [-1.42, -0.03, -0.05],
    ],
    [
      [-0.95, 0, -0.1],
      [-1.35, 0, -0.62],
      [-1.55, 0, -0.62],
      [-1.42, 0, -0.05],
    ],
  ];
}

/** @returns {Vector[][]} */
function multirotor() {
  const faces = box([-0.3, -0.22, -0.12], [0.38, 0.22, 0.12]);
  for (const [x, y] of [
    [1, 1],
    [1, -1],
    [-1, 1],
    [-1, -1],
  ]) {
    const [a, b] = [0.85 * x, 0.85 * y];
    faces.push([
      [0.2 * x, 0.12 * y, -0.02],
      [a, b, -0.1],
      [a + 0.05, b - 0.05, -0.1],
      [0.25 * x, 0.07 * y, -0.02],
    ]);
    faces.push(
      /** @type {Vector[]} */ (
        Array.from({ length: 12 }, (_, k) => [
          a + 0.42 * Math.cos((k * Math.PI) / 6),
          b + 0.42 * Math.sin((k * Math.PI) / 6),
          -0.16,
        ])
      ),
    );
  }
  return faces;
}

/** A box with an arrow forward, for a turntable or a vehicle of another package.
 * @returns {Vector[][]} */
function plain() {
  return [
    ...box([-0.9, -0.6, -0.25], [0.7, 0.6, 0.25]),
    [
      [0.7, -0.35, 0],
      [1.3, 0, 0],
      [0.7, 0.35, 0],
    ],
  ];
}

/** The faces of a vehicle's shape.
 * @param {string} shape  of its kind's traits
 * @returns {Vector[][]} */
export function meshOf(shape) {
  const shapes = { ship, car, aircraft, multirotor };
  return shape in shapes ? shapes[/** @type {keyof typeof shapes} */ (shape)]() : plain();
}
