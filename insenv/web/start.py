"""The start of a page's model in the page itself: what `insenv.scenario` draws and derives for a seed, as C.

A run starts in three steps: the plant's state from its parameters and seed; the initial knowledge of it, the truth
plus the errors of the start; and the estimators' state from that.  Each is the expression that Python evaluates, so that
another seed, latitude or heading gives the same bits.  The standard normals behind the errors are computed too, where the
inverse of their distribution is a quotient of polynomials (Wichura 1988, algorithm AS 241, as `statistics.NormalDist`).
In the tails it takes a logarithm, which machines round differently: for the seeds that a page offers, it holds these.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import casadi as ca
import numpy as np

from insenv import attitude, geodesy
from insenv.base.errors import InputError
from insenv.core.codegen import function_source
from insenv.core.noise import uniforms
from insenv.core.tables import Table, Vector
from insenv.estimators import Estimator, Knowledge
from insenv.scenario import KNOWLEDGE_STREAM, Plant
from insenv.web.model import PageModel

FIELDS = ("roll", "pitch", "heading", "latitude", "longitude", "height", "velocity_n")
"""Fields of `Knowledge` that depend on the truth at the start; with the three of the velocity there are nine numbers."""
KNOWN = 9

HALF_WIDTH, OFFSET = 0.425, 0.180625
NUMERATOR = (
    2.5090809287301226727e3, 3.3430575583588128105e4, 6.7265770927008700853e4, 4.5921953931549871457e4,
    1.3731693765509461125e4, 1.9715909503065514427e3, 1.3314166789178437745e2, 3.3871328727963666080e0,
)  # fmt: skip
DENOMINATOR = (
    5.2264952788528545610e3, 2.8729085735721942674e4, 3.9307895800092710610e4, 2.1213794301586595867e4,
    5.3941960214247511077e3, 6.8718700749205790830e2, 4.2313330701600911252e1, 1.0,
)  # fmt: skip
"""PPND16 of AS 241 for probabilities within `HALF_WIDTH` of 1/2, highest power first."""

_NORMALS = """
/* The standard normals (9) of a seed's start errors; in the tails 0, which the page replaces. */
EXPORTED(normals) void normals(double seed, double *z) {
  double u[12];
  uniforms(seed, 0.0, %du, 9, u);
  for (int i = 0; i < 9; ++i) {
    const double q = u[i] - 0.5, r = %r - q * q;
    z[i] = fabs(q) <= %r ? %s * q / %s : 0.0;
  }
}
"""

_BEGIN = """
/* Fill in what is stated to the estimators, and the state at time 0.  known: {normals, sigmas, errors, whether an error is
 * given}, nine of each.  Returns 1 if a reported angle is beyond a full turn: the functions that wrap it in Python are not
 * exactly rounded. */
EXPORTED(begin) int begin(const double *known, double *p, double *x) {
  double r[N_UNIFORMS + 1], e[9], stated[9];
  if (START_UNIFORMS) uniforms(p[SEED_PLACE], 0.0, 0xFFFFFFFFu, START_UNIFORMS, r);
  plant_start(p, r, x);
  for (int i = 0; i < 9; ++i) e[i] = known[27 + i] != 0 ? known[18 + i] : known[9 + i] * known[i];
  reported(x, e, stated);
  for (int i = 0; i < 3; ++i) if (fabs(stated[i]) > %s) return 1;
%s
  others_start(p, x + %d);
  return 0;
}
"""


def start_source(page: PageModel, plant: Plant) -> str:
    """C source of the export ``begin(known, p, x)``.  Raises `InputError` for an estimator that cannot be started so."""
    copies = "\n".join(f"  p[{at}] = stated[{source}];" for at, source in reported_places(page, plant))
    return "\n".join(
        [
            function_source("plant_start", page.plant.kernels["start"].function, "pr"),
            function_source("reported", _reported(page.plant.state), "xe"),
            function_source("others_start", _others(page), "p"),
            _NORMALS % (KNOWLEDGE_STREAM, OFFSET, HALF_WIDTH, _horner(NUMERATOR), _horner(DENOMINATOR)),
            _BEGIN % (repr(2.0 * np.pi), copies, page.plant.state.size),
        ]
    )


def _horner(coefficients: Sequence[float]) -> str:
    """A polynomial in r as C."""
    text = repr(coefficients[0])
    for each in coefficients[1:]:
        text = f"({text} * r + {each!r})"
    return text


def not_computed(normals: Vector, seeds: Sequence[int]) -> tuple[Vector, Vector]:
    """Places and values (k,) of those normals (n, 9) of seeds (n,) that the export ``normals`` does not give to the bit."""
    q = uniforms(np.array(seeds), 0, KNOWLEDGE_STREAM, 9) - 0.5
    r = OFFSET - q * q
    above, below = (np.full_like(r, row[0]) for row in (NUMERATOR, DENOMINATOR))
    for a, b in zip(NUMERATOR[1:], DENOMINATOR[1:], strict=True):
        above, below = above * r + a, below * r + b
    computed = np.where(np.abs(q) <= HALF_WIDTH, above * q / below, 0.0)
    at = np.flatnonzero(computed != normals)
    return at.astype(float), normals.ravel()[at]


def reported_places(page: PageModel, plant: Plant) -> list[tuple[int, int]]:
    """Pairs of an element of the page model's parameters and the one of the nine numbers that an estimator copies there.

    Found by asking each estimator for its parameters with other knowledge.  Raises `InputError` if one does more than copy.
    """
    places = []
    for member in page.members:
        first = page.model.parameters.slice(member.prefix + member.estimator.model.parameters.names[0]).start
        copied = _copied(member.estimator, plant)
        places += [(first + at, source) for at, source in copied]
    return places


def _copied(estimator: Estimator, plant: Plant) -> list[tuple[int, int]]:
    table = estimator.model.parameters
    base = table.pack(plant.parameters_of(estimator, offline=False))
    trials = []
    for scale in (1.0, -0.7):
        numbers = scale * np.array([0.0123, 0.0234, 0.345, 0.456, 0.567, 678.9, 1.1, 2.3, 0.4])
        values = {**dict(zip(FIELDS[:6], numbers[:6].tolist(), strict=True)), "velocity_n": numbers[6:]}
        known: Knowledge = replace(plant.knowledge, **values)
        trials.append((numbers, table.pack(estimator.parameters(known, plant.tunings))))
    places = []
    for at in range(table.size):
        if all(trial[at] == base[at] for _, trial in trials):
            continue
        sources = [i for i in range(KNOWN) if all(trial[at] == numbers[i] for numbers, trial in trials)]
        if len(sources) != 1:
            raise InputError(f"estimator {estimator.id!r} has no page: its start is computed from what is known, not copied")
        places.append((at, sources[0]))
    return places


def _reported(state: Table) -> Any:
    """The nine numbers of the initial knowledge, from the plant's state and the errors: `insenv.scenario.build`."""
    x, e = ca.SX.sym("x", state.size), ca.SX.sym("e", KNOWN)
    true = state.symbols(x)
    angles = [angle + e[i] for i, angle in enumerate(attitude.to_euler(true.q_nb))]
    place = geodesy.geodetic_from_ned_offset(e[3:6], true.latitude, true.longitude, true.height)
    numbers = ca.vertcat(*angles, *place, true.velocity_n + e[6:9])
    return ca.Function("reported", [x, e], [ca.densify(numbers)], {"cse": True})


def _others(page: PageModel) -> Any:
    """The state rows behind those of the plant, from the parameters."""
    model, plant = page.model, page.plant.state
    p, r = ca.SX.sym("p", model.parameters.size), ca.SX.sym("r", model.start_uniforms)
    named = model.parameters.symbols(p)
    begin: dict[str, Any] = {}
    if model.start is not None:
        begin = dict(model.start(named, r) if model.start_uniforms else model.start(named))
    rest = Table(tuple(row for row in model.state if row.name not in plant))
    values = {**vars(rest.symbols(ca.SX(ca.DM(rest.start_vector())))), **{k: v for k, v in begin.items() if k in rest}}
    return ca.Function("others_start", [p], [ca.densify(rest.assemble(values))], {"cse": True})


def known_vector(sigma: Vector, errors_stated: Sequence[float | None], drawn: Vector) -> Vector:
    """The argument `known` of ``begin``: normals, sigmas, errors, and whether each error is stated (36,)."""
    errors = [0.0 if value is None else value for value in errors_stated]
    return np.concatenate([drawn, sigma, errors, [float(value is not None) for value in errors_stated]])
