"""C source of a model: its functions and the hand-written driver.

The same function text serves one row and a block of rows: the type `real` is ``double`` or a vector of lanes.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from importlib.resources import files
from pathlib import Path
from typing import Any

from insenv.core.cache import source_digest
from insenv.core.instructions import EXPRESSIONS, Instruction, instructions, ordering, table_loop
from insenv.core.loops import LONG, Unit, plan
from insenv.core.model import Model
from insenv.core.traces import Kernel, Spans

# The C text of one function of a model, over the type ``real``: its instructions in the order of `ordering`, or in loops.


def function_text(level: str, name: str, kernel: Kernel, arguments: str, in_place: bool = False) -> str:
    """C text of ``name(arguments..., y)``, or without y of a function that changes its argument x (`in_place`).

    level: macro before the return type, by how often the function runs; "" for every sample.  arguments: a letter each.
    """
    steps = instructions(kernel.function)
    signature = ", ".join(f"{'' if in_place and letter == 'x' else 'const '}real *{letter}" for letter in arguments)
    signature += "" if in_place else ", real *y"
    before, lines = [], []
    if in_place:
        places = [i for span in kernel.spans for i in range(span.start, span.stop)]
        function = Statements(name, arguments, steps, [("x", place) for place in places])
        before_results = read_before(steps, [(arguments.index("x"), place) for place in places])
        lines = [function.statement(k) for k in ordering(steps, before_results)]
    elif (loop := table_loop(steps)) is not None:
        lines = loop.text(arguments)
    else:
        function = Statements(name, arguments, steps, [("y", place) for place in range(kernel.function.size1_out(0))])
        if len(steps) < LONG:
            lines = [function.statement(k) for k in ordering(steps, {})]
        else:
            written = plan(steps)
            for number, piece in enumerate(written.pieces):
                before += [f"static {level}PIECE void {name}_{number}({signature}, real *w) {{"]
                before += [*(f"  {line}" for line in function.piece(piece, written.places)), "}"]
            before = [_PIECE, *before]
            calls = [f"{name}_{number}({', '.join(arguments)}, y, w);" for number in range(len(written.pieces))]
            lines = [f"ON_A_LINE real w[{max(written.size, 1)}];", *calls]
    return "\n".join([*before, f"static {level}void {name}({signature}) {{", *(f"  {line}" for line in lines), "}\n"])


def read_before(steps: Sequence[Instruction], places: Sequence[tuple[int, int]]) -> dict[int, list[int]]:
    """By result, each written to its place (argument, element), the instruction that reads what was there."""
    read = {step.place: k for k, step in enumerate(steps) if step.name == "INPUT"}
    results = {k: places[step.place[1]] for k, step in enumerate(steps) if step.name == "OUTPUT"}
    return {k: [read[place]] for k, place in results.items() if place in read}


_PIECE = """#ifndef PIECE
#if defined(__GNUC__) || defined(__clang__)
#define PIECE __attribute__((noinline))
#else
#define PIECE
#endif
#endif"""


@dataclass(frozen=True)
class Precision:
    """How values of a precision are written.  type: in C.  work: array for those between pieces.  expressions: C text by
    operation."""

    type: str
    work: str
    expressions: Mapping[str, str]


REAL = Precision("real", "w", EXPRESSIONS)


@dataclass(frozen=True)
class Statements:
    """Statements of a function.  Value k is the variable ``vk``.

    arguments: their names in C.  results: array and element of each result.  precisions: the usual one, and that of
    instructions that are `Instruction.single`.
    """

    name: str
    arguments: Sequence[str]
    steps: Sequence[Instruction]
    results: Sequence[tuple[str, int]]
    precisions: Sequence[Precision] = (REAL,)

    def variable(self, k: int, name: str, value: str) -> str:
        """A variable that holds the value of instruction k."""
        return f"const {self.precisions[self.steps[k].single].type} {name} = {value};"

    def work(self, k: int) -> str:
        """The array through which the value of instruction k goes."""
        return self.precisions[self.steps[k].single].work

    def value(self, k: int, sources: Sequence[str]) -> str:
        """The value of instruction k; sources: those that it uses."""
        step, expressions = self.steps[k], self.precisions[self.steps[k].single].expressions
        if step.name == "INPUT":
            return f"{self.arguments[step.place[0]]}[{step.place[1]}]"
        if step.name == "CONST":
            return expressions["CONST"].format(repr(step.value))
        if step.name not in expressions:
            raise RuntimeError(f"function {self.name!r} of a model uses {step.name}: not an exactly rounded operation")
        return expressions[step.name].format(*sources)

    def statement(self, k: int) -> str:
        """Instruction k; its sources are variables."""
        step, sources = self.steps[k], [f"v{source}" for source in self.steps[k].sources]
        if step.name == "OUTPUT":
            array, element = self.results[step.place[1]]
            return f"{array}[{element}] = {sources[0]};"
        return self.variable(k, f"v{k}", self.value(k, sources))

    def piece(self, units: Sequence[Unit], places: Mapping[int, int]) -> list[str]:
        """The units of a piece.  places: in w, by instruction."""
        lines: list[str] = []
        known: set[int] = set()  # values that are variables of the piece
        for unit in units:
            if len(unit.roots) > 1:
                lines += self.loop(unit, places)
                continue
            (root,) = unit.roots
            for (k,) in unit.columns:
                if k not in known:
                    kept = f"{self.work(k)}[{places.get(k)}]"
                    lines.append(self.statement(k) if self.steps[k].is_leaf else self.variable(k, f"v{k}", kept))
            lines += [self.statement(k) for k in unit.work]
            lines += [f"{self.work(root)}[{places[root]}] = v{root};"] if root in places else []
            known |= {root, *unit.sources}
        return lines

    def loop(self, unit: Unit, places: Mapping[int, int]) -> list[str]:
        """A unit of several expressions: i is the number of the expression; a0, a1, ... are its operands."""
        table: list[list[int]] = []  # columns

        def element(array: str, numbers: list[int]) -> str:
            """The element of an array that expression i uses."""
            first, stride = numbers[0], numbers[1] - numbers[0]
            if all(number == first + stride * i for i, number in enumerate(numbers)):
                return f"{array}[{_index(first, stride)}]"
            if numbers not in table:
                table.append(numbers)
            return f"{array}[t[i][{table.index(numbers)}]]"

        before: list[str] = []
        inside: list[str] = []
        for c, column in enumerate(unit.columns):
            step = self.steps[column[0]]
            if step.name == "CONST":
                value = self.value(column[0], [])
            elif step.name == "INPUT":
                value = element(self.arguments[step.place[0]], [self.steps[k].place[1] for k in column])
            else:
                value = element(self.work(column[0]), [places[k] for k in column])
            (inside if re.search(r"\bi\b", value) else before).append(self.variable(column[0], f"a{c}", value))
        for k in unit.work:
            operands = zip(self.steps[k].sources, unit.operands[k], strict=True)
            values = [f"v{source}" if operand is None else f"a{operand}" for source, operand in operands]
            if self.steps[k].name == "OUTPUT":
                results = [self.results[self.steps[root].place[1]] for root in unit.roots]
                inside.append(f"{element(results[0][0], [number for _, number in results])} = {values[0]};")
            else:
                inside.append(self.variable(k, f"v{k}", self.value(k, values)))
        if unit.roots[0] in places:
            kept = element(self.work(unit.roots[0]), [places[root] for root in unit.roots])
            inside.append(f"{kept} = v{unit.roots[0]};")
        count, largest = len(unit.roots), max(map(max, table), default=0)
        rows = ",".join("{" + ",".join(map(str, row)) + "}" for row in zip(*table, strict=True))
        integer = "unsigned short" if largest < 2**16 else "unsigned int"
        return [
            "{",
            *([f"  static const {integer} t[{count}][{len(table)}] = {{{rows}}};"] if table else []),
            *(f"  {line}" for line in before),
            f"  for (int i = 0; i < {count}; i++) {{",
            *(f"    {line}" for line in inside),
            "  }",
            "}",
        ]


def _index(first: int, stride: int) -> str:
    """first + stride * i, without what multiplies by 1 or adds 0."""
    along = {0: "", 1: "i"}.get(stride, f"({stride} * i)")
    return " + ".join([*([str(first)] if first or not along else []), *([along] if along else [])])


WRITERS = "codegen", "instructions", "loops"
WRITER = source_digest(Path(__file__).with_name(f"{name}.py") for name in WRITERS)
"""Hash of the modules that write the functions of a model as C, taken when they are imported."""


def native_source(model: Model, functions: Mapping[str, str] | None = None) -> str:
    """C source of the model for one row.  functions: text by name, if not that of the model's equations."""
    return _source(model, "scalar.h", '#define EXPORT __attribute__((visibility("default")))', functions)


def embedded_source(model: Model) -> str:
    """C source of the model for one row, to be included by other C code: all its names are static."""
    return _source(model, "scalar.h", "#define EXPORT static inline")


def batch_source(model: Model, lanes: int | None = None, functions: Mapping[str, str] | None = None) -> str:
    """`native_source` for blocks of `lanes` rows (None: as many as a vector register holds)."""
    define = f"#define LANES {lanes}\n" if lanes else ""
    return _source(model, "lanes.h", define + '#define EXPORT __attribute__((visibility("default")))', functions)


def module_source(model: Model) -> str:
    """C source of the model for one row, to be included by other C code that starts it otherwise.

    Its start is left out, and each step stays a function of its own: a browser's compiler is slow on one huge function.
    """
    functions = {**_functions(model), "start": "static void start(const real *p, const real *r, real *y);"}
    source = _source(model, "scalar.h", "#define EXPORT static inline", functions)
    return re.sub(r"^static (SELDOM )?void ", "static __attribute__((noinline)) void ", source, flags=re.MULTILINE)


def function_source(name: str, function: Any, arguments: str) -> str:
    """C source ``name(..., y)`` of one function of flat columns, named by one letter each; it runs once per run."""
    return function_text("ONCE ", name, Kernel(function, (slice(0, function.size1_out(0)),)), arguments)


@lru_cache(maxsize=8)
def _functions(model: Model) -> Mapping[str, str]:
    """C source of the model's functions by name, over the type ``real``: the same for one row, for a block and in an FMU.

    ``start(p, r, y)``, ``output(p, x, y)`` and each conditional step ``NAME(p, x, u, r, y)`` write their results to y.
    A step without a condition, ``NAME(p, x, u, r)``, writes its results directly into x.
    """
    texts = {}
    for name, kernel in model.kernels.items():
        arguments = {"start": "pr", "output": "px"}.get(name, "pxur")
        in_place = name in model.steps and model.steps[name].when is None
        level = {"start": "ONCE ", "output": ""}.get(name, "" if in_place else "SELDOM ")
        texts[name] = function_text(level, name, kernel, arguments, in_place)
    return texts


def prelude(name: str) -> str:
    """The C text that defines ``real`` and its operations: "scalar.h" or "lanes.h"."""
    return (files("insenv.core") / "c" / name).read_text()


def _source(model: Model, header: str, export: str, functions: Mapping[str, str] | None = None) -> str:
    """functions: text by name, if not that of `_functions`."""
    driver = prelude("driver.h").replace("\nSTEPS\n", _steps(model))
    return "\n".join(
        [
            f"/* {model.id}: generated by insenv from the model's equations. */",
            export,
            prelude(header),
            *(_functions(model) if functions is None else functions).values(),
            _constants(model),
            driver,
        ]
    )


def _constants(model: Model) -> str:
    counts = [step.uniforms for step in model.steps.values()] + [model.start_uniforms]
    values = {
        "N_PARAMETER": model.parameters.size,
        "N_STATE": model.state.size,
        "N_INPUT": model.inputs.size,
        "N_OUTPUT": model.outputs.size,
        "N_UNIFORMS": max(counts),
        "START_UNIFORMS": model.start_uniforms,
        "SEED_PLACE": model.parameters.slice("seed").start if model.is_random else 0,
        "STEP_PLACE": model.state.slice("step").start if model.is_random else 0,
    }
    return "\n".join(f"#define {name} {value}" for name, value in values.items())


def _steps(model: Model) -> str:
    """The driver's functions `advance` and `run_step`, written out step by step so that the compiler can inline."""
    lays, advances, cases = [], [], []
    for k, (name, step) in enumerate(model.steps.items()):
        if step.when is None:
            call = f"RUN_STEP({k}, {name}, {step.uniforms})"
            advances.append(f"  {call};")
        else:
            lays += _lay(name, model.kernels.spans[name])
            call = f"RUN_STEP_WHERE({k}, {name}, lay_{name}, {step.uniforms}, %s)"
            letter, table = ("x", model.state) if step.when in model.state else ("u", model.inputs)
            place = f"{letter}[{table.slice(step.when).start}]"
            advances.append(f"  if (any({place})) {{ real mask = {place}; {call % 'mask'}; }}")
            call = call % "ONE"
        cases.append(f"    case {k}: {call}; break;")
    return "\n".join(
        [
            *lays,
            "static void advance(const real *p, real *x, const real *u) {",
            *advances,
            "}",
            "static void run_step(int k, const real *p, real *x, const real *u) {",
            "  switch (k) {",
            *cases,
            "  }",
            "}",
        ]
    )


def _lay(name: str, spans: Spans) -> list[str]:
    """The function that copies a conditional step's results into the state."""
    lines, done = [], 0
    for span in spans:
        lines.append(f"  LAY({span.start}, {span.stop}, {done})")
        done += span.stop - span.start
    head = f"static inline void lay_{name}(real *x, const real *changed, real mask) {{"
    return [head, "  int whole = all(mask);", *lines, "}"]
