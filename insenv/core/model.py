"""Model: a sampled system written once, as pure step functions over four tables.

A model does not depend on how it is run.  Its step functions are plain Python over CasADi symbols; `Model.kernels`
turns them into `casadi.Function`s of one common signature, and every runner (interpreter, native, batch, FMU) uses only
those. The kernel of a step computes only the rows that the step changes: rows that stay constant cost nothing.

One *advance* of a model runs its steps in order.  A step without a condition always runs.  A step with a condition
(``when="gnss_valid"``) runs only if that input, or that state row as left by the earlier steps, is not zero.  Rare
events thus cost nothing when they do not happen; in a batch they are masked row by row.

Randomness: a step that declares ``uniforms=n`` receives n uniforms in (0, 1), a pure function of the parameter
``seed``, the state row ``step`` and the number of the step in the model (see `insenv.core.noise`).  Nothing else is
random.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from types import SimpleNamespace
from typing import Any

from insenv.base.errors import InputError, naming
from insenv.core.tables import Row, Table, check_rows
from insenv.core.traces import Kernel, Traced

Values = SimpleNamespace
"""Symbols by row name, as passed to a step function: ``x.velocity_n`` is a 3x1 CasADi expression."""

SEED = Row("seed", "Seed of every random number of the model", lower=0, upper=2.0**53, whole=True)
STEP = Row("step", "Number of advances made since the start", lower=0, upper=2.0**53)


@dataclass(frozen=True)
class Step:
    """A pure step function and the condition under which it runs.

    function: ``(p, x, u) -> {state row: new value}``, or ``(p, x, u, r)`` if `uniforms` > 0, with the column r of
        uniforms. Rows that are not returned keep their value.
    when: name of an input or state row that must be non-zero for the step to run; None: it always runs.
    uniforms: number of uniform random numbers that the step uses.
    """

    function: Callable[..., Mapping[str, Any]]
    when: str | None = None
    uniforms: int = 0


@dataclass(frozen=True, eq=False, repr=False)
class Model:
    """The tables, steps and output function of a sampled system.

    Models compare equal only if they are the same object.

    id: short name, unique in its registry (``"q-method"``).
    title: one line for listings.
    parameters, state, inputs, outputs: the four tables.
    steps: the steps by name, in the order in which they run.
    output: ``(p, x) -> {output row: value}`` for every output row.
    start: ``(p) -> {state row: value}``, or ``(p, r)`` if `start_uniforms` > 0: the state at the start where it is not
        the table's start value.
    """

    id: str
    title: str
    parameters: Table
    state: Table
    inputs: Table
    outputs: Table
    steps: Mapping[str, Step]
    output: Callable[[Values, Values], Mapping[str, Any]]
    start: Callable[..., Mapping[str, Any]] | None = None
    start_uniforms: int = 0

    def __post_init__(self) -> None:
        this = f"model {self.id!r}"
        for name in ("parameters", "state", "inputs", "outputs"):
            if not isinstance(getattr(self, name), Table):
                raise InputError(f"{this}: {name} is of type {type(getattr(self, name)).__name__}: allowed is a Table")
        if not isinstance(self.steps, Mapping):
            raise InputError(f"{this}: steps is of type {type(self.steps).__name__}: allowed is a dict of Step by name")
        if not callable(self.output) or not (self.start is None or callable(self.start)):
            raise InputError(f"{this}: output and start must be functions; start may be None")
        for name, step in self.steps.items():
            if not isinstance(step, Step):
                raise InputError(f"{this}, step {name!r}: {type(step).__name__}: allowed is a Step, such as Step(function)")
            if not str(name).isidentifier() or name in ("start", "output"):
                raise InputError(f"{this}: a step cannot be named {name!r}")
            if step.when is not None and (step.when in self.state) == (step.when in self.inputs):
                raise InputError(f"{this}, step {name!r}: when = {step.when!r} must be one state or one input row")
        if self.is_random and not ("seed" in self.parameters and "step" in self.state):
            raise InputError(f"model {self.id!r} is random: it needs the parameter 'seed' and the state row 'step'")

    def __repr__(self) -> str:
        return f"Model({self.id!r})"

    @property
    def is_random(self) -> bool:
        """Whether a step or the start uses random numbers."""
        return self.start_uniforms > 0 or any(step.uniforms for step in self.steps.values())

    @cached_property
    def kernels(self) -> Traced:
        """The model's functions by name: "start", each step, "output".

        All take flat columns in table order: ``start(p, r)``, each step ``(p, x, u, r)``, ``output(p, x)``; r is empty
        if no random numbers are used.  They are read from the cache if it has those of the same sources and values, and
        traced if not.  Raises `InputError` that names the model and the step if a function fails or gives rows that are
        wrong.
        """
        from insenv.core import identity, traces
        from insenv.core.elementary import quick_operators

        known = identity.identity(self)
        cached = traces.read(known) if known else None
        if cached is not None:
            return cached
        with quick_operators():
            kernels = self._kernels()
        tables = (self.parameters, self.state, self.inputs, self.outputs)
        traced = traces.traced(kernels, str([table.rows for table in tables]))
        if known:
            traces.keep(known, traced)
        return traced

    def _kernels(self) -> dict[str, Kernel]:
        import casadi as ca

        p, x, u = (ca.SX.sym(n, t.size) for n, t in zip("pxu", (self.parameters, self.state, self.inputs), strict=True))
        names = self.parameters.symbols(p), self.state.symbols(x), self.inputs.symbols(u)

        r = ca.SX.sym("r", self.start_uniforms)
        begin: Mapping[str, Any] = {}
        base = ca.SX(ca.DM(self.state.start_vector()))
        with naming(f"model {self.id!r}, start"):
            if self.start is not None:
                begin = check_rows(self.start(names[0], r) if self.start_uniforms else self.start(names[0]), self.state)
            kernels = {"start": _kernel("start", [p, r], self.state, {**vars(self.state.symbols(base)), **begin})}

        for name, step in self.steps.items():
            r = ca.SX.sym("r", step.uniforms)
            with naming(f"model {self.id!r}, step {name!r}"):
                changed = step.function(*names, r) if step.uniforms else step.function(*names)
                kernels[name] = _kernel(name, [p, x, u, r], self.state, changed)
        with naming(f"model {self.id!r}, output"):
            values = check_rows(self.output(*names[:2]), self.outputs)
            self.outputs.assemble(values)
            kernels["output"] = _kernel("output", [p, x], self.outputs, values)
        return kernels

    @property
    def fingerprint(self) -> str:
        """Hash of the tables and equations: models with the same give the same numbers."""
        return self.kernels.fingerprint

    @cached_property
    def functions(self) -> dict[str, Any]:
        """Functions by name for analysis: as in `kernels`, but a step ``(p, x, u, r) -> x`` gives the whole state."""
        import casadi as ca

        functions = {}
        for name, kernel in self.kernels.items():
            arguments = [ca.SX.sym(f"a{i}", kernel.function.size1_in(i)) for i in range(kernel.function.n_in())]
            result = kernel.function(*arguments)
            if name in self.steps:
                whole = [arguments[1][i] for i in range(self.state.size)]
                for span, part in kernel.pieces:
                    whole[span] = [result[i] for i in range(part.start, part.stop)]
                result = ca.vertcat(*whole)
            functions[name] = ca.Function(name, arguments, [result])
        return functions


def _kernel(name: str, arguments: list[Any], table: Table, values: Mapping[str, Any]) -> Kernel:
    import casadi as ca

    from insenv.core.instructions import check_exact

    check_rows(values, table)
    part = Table(tuple(row for row in table if row.name in values))
    # share common subexpressions: Python helpers may compute the same quantity twice
    function = ca.Function(name, arguments, [ca.densify(part.assemble(values))], {"cse": True})
    if not _is_finite(function):
        for row in part:
            if not _is_finite(ca.Function(name, arguments, [ca.SX(values[row.name])])):
                raise InputError(f"row {row.name!r} contains a constant that is not finite, such as a division by 0")
    check_exact(function)
    return Kernel(function, table.spans(part.names))


def _is_finite(function: Any) -> bool:
    """Whether all constants of an SX function are finite."""
    import casadi as ca

    name_of, constant = function.instruction_id, function.instruction_constant
    return all(math.isfinite(constant(k)) for k in range(function.n_instructions()) if name_of(k) == ca.OP_CONST)


def derived(table: Table, **start: Any) -> Table:
    """`table` with other start values for the named rows; raises `InputError` for an unknown row."""
    for name in start:
        table.slice(name)
    return Table(tuple(replace(row, start=start.get(row.name, row.start)) for row in table))
