"""A model as portable C: ``NAME.h`` and ``NAME.c`` for a microcontroller, with named members, checks and no heap.

The functions hold the operations of `insenv.core.codegen` in the same order, so that the results are bit-identical to
those of every runner.  Values between the pieces of a function, and its results, go through arrays of the caller's struct: the
stack holds only the local variables of one piece.  The hand-written text around them is ``c/portable.h`` and ``c/portable.c``.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from importlib.resources import files

from insenv.base.errors import InputError
from insenv.base.shipped import __version__
from insenv.core.codegen import Statements, read_before
from insenv.core.instructions import instructions, ordering
from insenv.core.loops import plan
from insenv.core.model import Model
from insenv.core.tables import Row, Table, Vector, flag_of
from insenv.core.traces import Kernel

EXPRESSIONS = {
    "ADD": "{} + {}",
    "SUB": "{} - {}",
    "MUL": "{} * {}",
    "DIV": "{} / {}",
    "INV": "1.0 / {}",
    "NEG": "-{}",
    "TWICE": "2.0 * {}",
    "SQ": "{0} * {0}",
    "SQRT": "sqrt({})",
    "FLOOR": "floor({})",
    "FABS": "fabs({})",
    "LT": "({} < {}) ? 1.0 : 0.0",
    "LE": "({} <= {}) ? 1.0 : 0.0",
    "EQ": "({} == {}) ? 1.0 : 0.0",
    "NE": "({} != {}) ? 1.0 : 0.0",
    "NOT": "({} == 0.0) ? 1.0 : 0.0",
    "AND": "(({} != 0.0) && ({} != 0.0)) ? 1.0 : 0.0",
    "OR": "(({} != 0.0) || ({} != 0.0)) ? 1.0 : 0.0",
    "IF_ELSE_ZERO": "({} != 0.0) ? {} : 0.0",
    "ASSIGN": "{}",
    "CONST": "{}",
}
"""The operations of `insenv.core.codegen` in plain C; the operands are variables."""
PIECE = 400
"""Statements of a piece: its local variables are what a function has on the stack."""
STRAIGHT = 1500
"""Instructions up to which a step that always runs is one piece, which writes its results directly into the state."""
KEYWORDS = frozenset(
    re.findall(
        r"\w+",
        """
    asm auto bool break case catch char class const continue default delete do double else enum explicit export extern false
    float for friend goto if inline int long mutable namespace new operator private protected public register restrict
    return short signed sizeof static struct switch template this throw true try typedef typeid typename union unsigned
    using virtual void volatile while
""",
    )
)
"""Of C99 and C++."""


def identifier(name: str) -> str:
    """`name` as a C identifier."""
    name = re.sub(r"\W", "_", name)
    return name if name[0].isalpha() else f"model_{name}"


@dataclass(frozen=True)
class Portable:
    """What the C text of a model says beside its equations.

    name: prefix of all public names, a C identifier.  defaults: values of its parameters.  dt: shortest and longest length of
    a sample (s) that is taken.  values_from: a sentence that says where the defaults come from.
    """

    name: str
    defaults: Vector
    dt: tuple[float, float]
    values_from: str


def c_files(model: Model, portable: Portable) -> dict[str, str]:
    """The texts of ``NAME.h`` and ``NAME.c`` by file name.

    Raises `InputError` for a model that is random, without inputs, or with a row that C cannot name.
    """
    if model.is_random:
        raise InputError(f"model {model.id!r} is random: allowed as C is a model without random numbers")
    for table in (model.parameters, model.inputs, model.outputs):
        for row in table:
            if row.name in KEYWORDS or not row.name.isascii():
                raise InputError(f"row {row.name!r} of model {model.id!r}: allowed in C is a name in ASCII that is no keyword")
        if not table.size:
            raise InputError(f"model {model.id!r} has no parameters, inputs or outputs: its C would have an empty struct")
    written = [_written(model, name) for name in model.kernels]
    fields = {
        "title": model.title[:1].upper() + model.title[1:],
        "id": model.id,
        "version": __version__,
        "values_from": portable.values_from,
        "name": portable.name,
        "NAME": portable.name.upper(),
        "dt_min": repr(portable.dt[0]),
        "dt_max": repr(portable.dt[1]),
        "parameters": _members(model.parameters),
        "inputs": _members(model.inputs),
        "outputs": _members(model.outputs),
        "n_parameters": str(model.parameters.size),
        "n_state": str(model.state.size),
        "n_inputs": str(model.inputs.size),
        "n_outputs": str(model.outputs.size),
        "n_results": str(max(*(each.results for each in written), model.outputs.size, model.parameters.size)),
        "n_work": str(max(1, *(each.work for each in written))),
        "defaults": _initializer(model.parameters, portable.defaults),
        "parameter_rows": _rows(model.parameters),
        "input_rows": _rows(model.inputs),
        "check_dt": _check_dt(model, portable.name),
        "functions": "\n".join(each.text for each in written),
        "start": next(each.call for each in written if each.name == "start") % "f->x",
        "output": next(each.call for each in written if each.name == "output") % "f->y",
        "steps": "\n".join(_advance(model, written)),
    }
    return {f"{portable.name}.{ending}": _filled(ending, fields) for ending in ("h", "c")}


@dataclass(frozen=True)
class _Written:
    """The C text of a function.  call: of it, with members of `f`, whose results go to `%s`.  work, results: numbers that it
    needs of the workspace.  in_place: whether its results go directly into the state."""

    name: str
    text: str
    call: str
    work: int
    results: int
    in_place: bool


def _written(model: Model, name: str) -> _Written:
    kernel, arguments = model.kernels[name], {"start": "pr", "output": "px"}.get(name, "pxur")
    always = name in model.steps and model.steps[name].when is None
    steps = instructions(kernel.function)
    used = {arguments[step.place[0]] for step in steps if step.name == "INPUT"}
    function = f"step_{name}" if name in model.steps else name
    if always and len(steps) <= STRAIGHT:
        return _in_place(name, function, kernel, arguments, used)
    statements = Statements(name, arguments, steps, [f"y[{k}]" for k in range(kernel.function.size1_out(0))], EXPRESSIONS)
    planned = plan(steps, longest=PIECE)
    letters = [letter for letter in "pxu" if letter in used]
    signature = ", ".join([*(f"const double *{letter}" for letter in letters), "double *y", "double *w"])
    lines, calls = [], []
    for number, piece in enumerate(planned.pieces):
        body = [line.replace("const real ", "const double ") for line in statements.piece(piece, planned.places)]
        touched = {letter for letter in ["y", "w", *letters] if re.search(rf"\b{letter}\[", "\n".join(body))}
        here = ", ".join(part for part in signature.split(", ") if part[-1] in touched)
        if "w" in touched and not any(line.lstrip().startswith("w[") for line in body):
            here = here.replace("double *w", "const double *w")
        lines += [f"APART static void {function}_{number}({here or 'void'}) {{", *(f"  {line}" for line in body), "}", ""]
        calls.append(f"  {function}_{number}({', '.join(part[-1] for part in signature.split(', ') if part[-1] in touched)});")
    lines += [f"static void {function}({signature}) {{", *calls, *([] if planned.size else ["  (void)w;"]), "}", ""]
    given = ", ".join([*(f"f->{letter}" for letter in letters), "%s", "f->w"])
    results = 0 if name == "start" else kernel.function.size1_out(0)
    return _Written(name, "\n".join(lines), f"{function}({given})", planned.size, results, False)


def _in_place(name: str, function: str, kernel: Kernel, arguments: str, used: set[str]) -> _Written:
    """A function whose results are written into the state, each once what was there is no longer read."""
    steps = instructions(kernel.function)
    places = [i for span in kernel.spans for i in range(span.start, span.stop)]
    statements = Statements(name, arguments, steps, [f"x[{place}]" for place in places], EXPRESSIONS)
    order = ordering(steps, read_before(steps, arguments.index("x"), places))
    lines = [statements.statement(k).replace("const real ", "const double ") for k in order]
    letters = [letter for letter in "pxu" if letter in used | {"x"}]
    signature = ", ".join(f"{'' if letter == 'x' else 'const '}double *{letter}" for letter in letters)
    text = "\n".join([f"APART static void {function}({signature}) {{", *(f"  {line}" for line in lines), "}", ""])
    return _Written(name, text, f"{function}({', '.join(f'f->{letter}' for letter in letters)})", 0, 0, True)


def _advance(model: Model, written: Iterable[_Written]) -> list[str]:
    """The steps in their order, each under its condition, and the copies of their results into the state."""
    of, lines = {each.name: each for each in written}, []
    for number, (name, step) in enumerate(model.steps.items()):
        each = of[name]
        body = [f"{each.call if each.in_place else each.call % 'f->y'};"]
        if not each.in_place:
            body += [
                f"(void)memcpy(&f->x[{span.start}], &f->y[{part.start}], {span.stop - span.start}u * sizeof(double));"
                for span, part in model.kernels[name].pieces
            ]
        body.append(f"STEP_DONE({number}); /* {name} */")
        if step.when is not None:
            letter, table = ("x", model.state) if step.when in model.state else ("u", model.inputs)
            condition = f"if (f->{letter}[{table.slice(step.when).start}] != 0.0) {{ /* {step.when} */"
            body = [condition, *(f"  {line}" for line in body), "}"]
        lines += [f"  {line}" for line in body]
    return lines


def _check_dt(model: Model, name: str) -> str:
    """The check of the length of a sample, if the model has it as an input."""
    if "dt" not in model.inputs:
        return ""
    place, macro = model.inputs.slice("dt").start, name.upper()
    condition = f"(f->u[{place}] < {macro}_DT_MIN) || (f->u[{place}] > {macro}_DT_MAX)"
    return f"  if ({condition}) {{\n    f->wrong = {place};\n    return {macro}_WRONG_DT;\n  }}\n"


def _members(table: Table) -> str:
    """The members of a struct, each with unit, frame and meaning."""
    lines = []
    for row in table:
        shape = "".join(f"[{n}]" for n in row.shape)
        unit = "0 or 1" if row.flag else row.unit
        frame = f", {row.frame}" if row.frame else ""
        meaning = row.meaning.replace("*/", "* /").encode("ascii", "replace").decode()
        lines.append(f"  double {row.name}{shape}; /* {unit}{frame}: {meaning} */")
    return "\n".join(lines)


def _initializer(table: Table, values: Vector) -> str:
    """The values of a struct, a member a line; a matrix as its rows."""
    lines = []
    for row in table:
        numbers = [repr(float(value)) for value in values[table.slice(row.name)]]
        if len(row.shape) == 2:
            width = row.shape[1]
            numbers = [_braced(numbers[k : k + width]) for k in range(0, len(numbers), width)]
        lines.append(f"  {_braced(numbers) if row.shape else numbers[0]}, /* {row.name} */")
    return "\n".join(lines)


def _braced(numbers: Sequence[str]) -> str:
    return "{" + ", ".join(numbers) + "}"


def _rows(table: Table) -> str:
    """The rows as the checks need them: place, size, number of the row of its flag or -1, bounds, start, whether whole."""
    lines = []
    for row in table:
        flag = flag_of(row.name, [each.name for each in table if each.flag])
        number = -1 if flag is None else table.names.index(flag)
        numbers = (str(table.slice(row.name).start), str(row.size), str(number), str(int(row.whole or row.flag)))
        lines.append(
            f"  {{{', '.join((*numbers, *map(_bound, (row.lower, row.upper)), repr(_start(row))))}}}, /* {row.name} */"
        )
    return "\n".join(lines)


def _start(row: Row) -> float:
    return float(row.flat_start()[0]) if row.size else 0.0


def _bound(value: float) -> str:
    return repr(float(value)) if math.isfinite(value) else ("DBL_MAX" if value > 0 else "-DBL_MAX")


def _filled(ending: str, fields: dict[str, str]) -> str:
    """The hand-written text with its ``@field@`` filled in."""
    text = (files("insenv.core") / "c" / f"portable.{ending}").read_text(encoding="utf-8")
    return re.sub(r"@(\w+)@", lambda found: fields[found[1]], text)
