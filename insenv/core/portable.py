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
from textwrap import wrap

from insenv.base.errors import InputError
from insenv.base.shipped import __version__
from insenv.core.codegen import Precision, Statements, read_before
from insenv.core.instructions import Instruction, instructions, ordering
from insenv.core.loops import plan
from insenv.core.model import Model
from insenv.core.precision import Tolerance, between_single, in_precisions, without_effect
from insenv.core.tables import Row, Table, Vector, flag_of

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
_FLOAT = {name: re.sub(r"(\d\.\d)", r"\1F", re.sub(r"^(sqrt|floor|fabs)", r"\1f", text)) for name, text in EXPRESSIONS.items()}
PRECISIONS = (
    Precision("double", "w", {**EXPRESSIONS, "DOUBLE": "(double){}"}),
    Precision("float", "wf", {**_FLOAT, "SINGLE": "(float){}", "CONST": "{}F"}),
)
"""Double and single precision."""
ARRAYS = {name: PRECISIONS[name.endswith("f")].type for name in ("p", "x", "xf", "u", "y", "yf", "w", "wf")}
"""Arrays of the caller's struct, in the order in which functions take them, and their types."""
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
    a sample (s) that is taken.  values_from: a sentence that says where the defaults come from.  single: whether each element
    of the state is kept in single precision; empty: none is.  tolerance: by which operations are in it; None: by what lies
    between those elements (`insenv.core.precision`).
    """

    name: str
    defaults: Vector
    dt: tuple[float, float]
    values_from: str
    single: Sequence[bool] = ()
    tolerance: Tolerance | None = None


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
    places = _places(portable.single or [False] * model.state.size)
    sizes = [sum(kind == k for kind, _ in places) for k in range(2)]
    written = [_written(model, name, places, portable) for name in model.kernels]
    title = model.title[:1].upper() + model.title[1:]
    fields = {
        "heading": "\n * ".join(wrap(f"{title} ({model.id}), written by insenv {__version__}.", 125)),
        "values_from": portable.values_from,
        "same": (
            "Numbers are the same wherever float and double are IEEE 754 binary32 and binary64"
            if portable.single
            else "Numbers are bit-identical to those of insenv where double is IEEE 754 binary64"
        ),
        "name": portable.name,
        "NAME": portable.name.upper(),
        "dt_min": repr(portable.dt[0]),
        "dt_max": repr(portable.dt[1]),
        "parameters": _members(model.parameters),
        "inputs": _members(model.inputs),
        "outputs": _members(model.outputs),
        "n_parameters": str(model.parameters.size),
        "n_state": str(max(1, sizes[0])),
        "n_inputs": str(model.inputs.size),
        "n_outputs": str(model.outputs.size),
        "n_results": str(max(*(each.results[0] for each in written), model.outputs.size, model.parameters.size)),
        "n_work": str(max(1, *(each.work[0] for each in written))),
        "single": _single_members(sizes[1], written) if portable.single else "",
        "defaults": _initializer(model.parameters, portable.defaults),
        "parameter_rows": _rows(model.parameters),
        "input_rows": _rows(model.inputs),
        "check_dt": _check_dt(model, portable.name),
        "functions": "\n".join(each.text for each in written),
        "start": next(each.call for each in written if each.name == "start").replace("f->y", "f->x"),
        "output": next(each.call for each in written if each.name == "output"),
        "steps": "\n".join(_advance(model, written, places)),
    }
    return {f"{portable.name}.{ending}": _filled(ending, fields) for ending in ("h", "c")}


_Place = tuple[int, int]
"""Precision (0 double, 1 single) and the element in the array of that precision."""


def _places(single: Sequence[bool]) -> list[_Place]:
    """Where each element of the state lies."""
    sizes, places = [0, 0], []
    for kind in map(int, single):
        places.append((kind, sizes[kind]))
        sizes[kind] += 1
    return places


def _single_members(size: int, written: Sequence[_Written]) -> str:
    """The members of the struct for single precision."""
    results, work = (max(1, *(getattr(each, name)[1] for each in written)) for name in ("results", "work"))
    return f"\n  float xf[{size}]; /* state in single precision */\n  float yf[{results}];\n  float wf[{work}];"


@dataclass(frozen=True)
class _Written:
    """The C text of a function.  call: of it, with members of `f`.  work, results: numbers that it needs of the workspace, of
    double and of single precision.  copies: what brings its results from there into the state."""

    name: str
    text: str
    call: str
    work: tuple[int, int] = (0, 0)
    results: tuple[int, int] = (0, 0)
    copies: Sequence[str] = ()


def _written(model: Model, name: str, places: Sequence[_Place], portable: Portable) -> _Written:
    kernel, arguments = model.kernels[name], {"start": "pr", "output": "px"}.get(name, "pxur")
    steps = instructions(kernel.function)
    elements = [i for span in kernel.spans for i in range(span.start, span.stop)]
    targets = [(0, k) for k in range(len(elements))] if name == "output" else [places[i] for i in elements]
    if portable.single:
        x = arguments.find("x")
        moved = {(x, i): ((x, len(arguments))[kind], place) for i, (kind, place) in enumerate(places)}
        steps = in_precisions(steps, _in_single(steps, name, x, elements, portable))
        steps = [step._replace(place=moved.get(step.place, step.place)) if step.name == "INPUT" else step for step in steps]
    function = f"step_{name}" if name in model.steps else name
    names = [*arguments, "xf"]
    if name in model.steps and model.steps[name].when is None and len(steps) <= STRAIGHT:
        results = [(("x", "xf")[kind], place) for kind, place in targets]
        statements = Statements(name, names, steps, results, PRECISIONS)
        order = ordering(steps, read_before(steps, [(names.index(array), place) for array, place in results]))
        lines = [statements.statement(k) for k in order]
        return _Written(name, _function(f"APART static void {function}", lines, lines), _call(function, lines))
    # elsewhere results go through y, but those of the start directly into the state
    counted, sizes = [], [0, 0]
    for kind, place in targets:
        counted.append((kind, sizes[kind] if name in model.steps else place))
        sizes[kind] += 1
    statements = Statements(name, names, steps, [(("y", "yf")[kind], place) for kind, place in counted], PRECISIONS)
    planned = plan(steps, longest=PIECE)
    text, calls, whole = [], [], list[str]()
    for number, piece in enumerate(planned.pieces):
        body = statements.piece(piece, planned.places)
        text.append(_function(f"APART static void {function}_{number}", body, body))
        calls.append(f"{_call(f'{function}_{number}', body).replace('f->', '')};")
        whole += body
    text.append(_function(f"static void {function}", calls, whole))
    results_needed = (0, 0) if name == "start" else (sizes[0], sizes[1])
    copies = _copies(targets, counted) if name in model.steps else []
    work = planned.size, planned.single_size
    return _Written(name, "\n".join(text), _call(function, whole), work, results_needed, copies)


def _in_single(steps: Sequence[Instruction], name: str, x: int, elements: Sequence[int], portable: Portable) -> Sequence[bool]:
    """Whether each instruction of a function is in single precision.  x: number of the argument that is the state, or -1.
    elements: of the state or the outputs that the results are."""
    tolerance = portable.tolerance

    def ends(of_state: Sequence[bool]) -> list[bool]:
        """Whether each INPUT is, or each OUTPUT goes to, an element of the state of which this is true."""
        taken = [step.name == "INPUT" and step.place[0] == x and of_state[step.place[1]] for step in steps]
        results = [name != "output" and of_state[i] for i in elements]
        return [results[step.place[1]] if step.name == "OUTPUT" else taken[k] for k, step in enumerate(steps)]

    if tolerance is None:
        return between_single(steps, ends(portable.single))
    between, kept = between_single(steps, ends(tolerance.between)), ends(portable.single)
    known = [kept[k] if step.name in ("INPUT", "OUTPUT") else between[k] for k, step in enumerate(steps)]
    largest = tolerance.outputs if name == "output" else tolerance.state
    return without_effect(steps, known, tolerance.points[name], [largest[i] for i in elements])


def _function(head: str, lines: Sequence[str], uses: Sequence[str]) -> str:
    """The C text of a function of these lines.  uses: lines that show which arrays it needs, and which it writes to."""
    changed = re.findall(r"^ *([a-z]+)\[", "\n".join(uses), re.MULTILINE)
    declared = [f"{'' if name in changed else 'const '}{ARRAYS[name]} *{name}" for name in _arrays(uses)]
    return "\n".join([f"{head}({', '.join(declared) or 'void'}) {{", *(f"  {line}" for line in lines), "}", ""])


def _call(function: str, uses: Sequence[str]) -> str:
    return f"{function}({', '.join(f'f->{name}' for name in _arrays(uses))})"


def _arrays(lines: Sequence[str]) -> list[str]:
    """The arrays that these lines use."""
    found = set(re.findall(r"\b([a-z]+)\[", "\n".join(lines)))
    return [name for name in ARRAYS if name in found]


def _copies(targets: Sequence[_Place], counted: Sequence[_Place]) -> list[str]:
    """The copies of results into the state, each of as many neighbours as possible."""
    runs: list[list[int]] = []  # precision, first element of the state and of the results, number
    for (kind, place), (_, result) in zip(targets, counted, strict=True):
        if runs and runs[-1][0] == kind and (runs[-1][1] + runs[-1][3], runs[-1][2] + runs[-1][3]) == (place, result):
            runs[-1][3] += 1
        else:
            runs.append([kind, place, result, 1])
    return [
        f"(void)memcpy(&f->x{suffix}[{place}], &f->y{suffix}[{result}], {count}u * sizeof({PRECISIONS[kind].type}));"
        for kind, place, result, count in runs
        for suffix in ("", "f")[kind : kind + 1]
    ]


def _advance(model: Model, written: Iterable[_Written], places: Sequence[_Place]) -> list[str]:
    """The steps in their order, each under its condition, and the copies of their results into the state."""
    of, lines = {each.name: each for each in written}, []
    for number, (name, step) in enumerate(model.steps.items()):
        body = [f"{of[name].call};", *of[name].copies, f"STEP_DONE({number}); /* {name} */"]
        if step.when is not None:
            array, place = "u", model.inputs.slice(step.when).start if step.when in model.inputs else 0
            if step.when in model.state:
                kind, place = places[model.state.slice(step.when).start]
                array = ("x", "xf")[kind]
            condition = f"if (f->{array}[{place}] != {'0.0F' if array == 'xf' else '0.0'}) {{ /* {step.when} */"
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
        lines.append(f"  {{{', '.join((*numbers, *map(bound, (row.lower, row.upper)), repr(_start(row))))}}}, /* {row.name} */")
    return "\n".join(lines)


def _start(row: Row) -> float:
    return float(row.flat_start()[0]) if row.size else 0.0


def bound(value: float) -> str:
    """A bound of a row in C, where infinity is the largest number."""
    return repr(float(value)) if math.isfinite(value) else ("DBL_MAX" if value > 0 else "-DBL_MAX")


def _filled(ending: str, fields: dict[str, str]) -> str:
    """The hand-written text with its ``@field@`` filled in."""
    text = (files("insenv.core") / "c" / f"portable.{ending}").read_text(encoding="utf-8")
    return re.sub(r"@(\w+)@", lambda found: fields[found[1]], text)
