"""The C sources of an FMU: the files of fmu/c, the generated equations of the model, and config.h from its tables."""

from __future__ import annotations

import hashlib
import re
from collections.abc import Iterable, Mapping, Sequence

from insenv.base.resources import fmu_folder
from insenv.core.codegen import embedded_source
from insenv.core.portable import bound
from insenv.core.tables import Row, flag_of
from insenv.fmu.subject import Subject
from insenv.fmu.variables import NOT_GIVEN, SAMPLE_NUMBER, SAMPLED, STEP_IS_ONE_INCREMENT, Kind, Variable

TOKEN = "@TOKEN@"
"""Placeholder in sources and description for the token, which is a hash of both."""
_HEADERS = {2: ("fmi2Functions.h", "fmi2FunctionTypes.h", "fmi2TypesPlatform.h"),
            3: ("fmi3Functions.h", "fmi3FunctionTypes.h", "fmi3PlatformTypes.h")}  # fmt: skip
_INCLUDE = re.compile(r'^[ \t]*#include "([^"]+)"[ \t]*$', re.MULTILINE)
OVERRIDE = "FMI{}_OVERRIDE_FUNCTION_PREFIX"
"""Macro that leaves the functions of a shared library their plain names, by version of FMI."""
MAX_SAMPLES = 10**9
"""Largest number of samples in a communication step."""
_TUNABLE = 6  # the kind of a tunable parameter in fmu/c/instance.h


def sources(subject: Subject, variables: Sequence[Variable], fmi: int, arrays: bool) -> dict[str, str]:
    """The files of ``sources/`` by name; the first is compiled and includes the others and the headers of the standard."""
    folder = fmu_folder()
    main = main_source(fmi)
    return {
        main: (folder / "c" / main).read_text(encoding="utf-8"),
        "instance.h": (folder / "c" / "instance.h").read_text(encoding="utf-8"),
        "config.h": config(subject, variables, arrays),
        "equations.h": embedded_source(subject.model),
    }


def main_source(fmi: int) -> str:
    """Name of the file to compile."""
    return f"fmi{fmi}.c"


def amalgamated(files: Mapping[str, str], fmi: int) -> str:
    """The text of a shared library: the main source with its includes replaced by the text of the files, each once.

    Its functions have their plain names.
    """
    taken: set[str] = set()
    headers = {name: (fmu_folder() / "headers" / name).read_text(encoding="utf-8") for name in _HEADERS[fmi]}
    files = {**files, **headers}

    def whole(name: str) -> str:
        taken.add(name)
        return _INCLUDE.sub(lambda include: "" if include[1] in taken else whole(include[1]), files[name])

    return f"#define {OVERRIDE.format(fmi)}\n{whole(main_source(fmi))}"


def token(description: str, files: Mapping[str, str], further: Iterable[str]) -> str:
    """A GUID: hash of the description, the sources and the further texts that determine the behaviour of the FMU."""
    digest = hashlib.sha256()
    for text in (description, *(text for item in sorted(files.items()) for text in item), *further):
        digest.update(text.encode() + b"\0")
    h = digest.hexdigest()
    return f"{{{h[:8]}-{h[8:12]}-{h[12:16]}-{h[16:20]}-{h[20:32]}}}"


def config(subject: Subject, variables: Sequence[Variable], arrays: bool) -> str:
    """config.h: sizes, start values, rows with their bounds."""
    model = subject.model
    size = sum(v.row.size for v in variables)
    parameter = size - model.outputs.size - model.inputs.size - model.parameters.size
    first_input = parameter + model.parameters.size
    input_row = len(variables) - len(model.outputs.rows) - len(model.inputs.rows)
    defines = {
        "TOKEN": f'"{TOKEN}"',
        "MODEL_PREFIX": f"{subject.identifier}_",
        "ARRAYS": f"{int(arrays)} /* whether a value reference is a row */",
        "SAMPLE_INTERVAL": f"{subject.sample_interval!r} /* s */",
        "MAX_SAMPLES": f"{MAX_SAMPLES} /* in one step */",
        "N_ROW": len(variables),
        "N_VALUE": size,
        "FIRST_PARAMETER": parameter,
        "FIRST_INPUT": first_input,
        "FIRST_OUTPUT": first_input + model.inputs.size,
        "FIRST_INPUT_ROW": input_row,
        "N_INPUT_ROW": len(model.inputs.rows),
    }
    inputs = {v.row.name: v for v in variables if v.kind is Kind.INPUT}
    defines["ONE_SAMPLE_A_STEP"] = int(subject.kind == "estimator")
    if subject.kind == "estimator" and "dt" in inputs:
        name = STEP_IS_ONE_INCREMENT.name
        place = next(v.place for v in variables if v.kind is Kind.PARAMETER and v.row.name == name)
        defines |= {"DT": inputs["dt"].place, name.upper(): place}
        if SAMPLE_NUMBER.name in inputs:
            defines |= {name.upper(): inputs[name].place for name in (SAMPLE_NUMBER.name, *SAMPLED)}
            defines["NOT_GIVEN"] = f"({NOT_GIVEN!r}) /* sample_number */"
    rows = [f"  {{{', '.join(_fields(v, inputs))}}}," for v in variables]
    start = [value for v in variables for value in (v.start if v.start is not None else [0.0] * v.row.size)]
    kinds = [str(_TUNABLE if v.tunable else int(v.kind)) for v in variables for _ in range(v.row.size)]
    flags = [str(int(v.row.flag)) for v in variables for _ in range(v.row.size)]
    return "\n".join(
        [
            f"/* {subject.id}: sizes and tables of its variables, generated by insenv. */",
            *(f"#define {name} {value}" for name, value in defines.items()),
            "",
            "/* whole: only whole numbers.  flag: place of the input that says whether this one is used, or -1 */",
            "typedef struct { const char *name, *unit; size_t place, size; double lower, upper; int whole, flag; } Row;",
            "static const Row ROWS[N_ROW] = {",
            *rows,
            "};",
            "static const double START[N_VALUE] = {",
            *_lines([repr(float(value)) for value in start]),
            "};",
            "static const unsigned char KIND[N_VALUE] = {",
            *_lines(kinds, 32),
            "};",
            "/* whether a place holds a Boolean */",
            "static const unsigned char FLAG[N_VALUE] = {",
            *_lines(flags, 32),
            "};",
            "",
        ]
    )


def _fields(variable: Variable, inputs: Mapping[str, Variable]) -> list[str]:
    """The fields of a `Row` in C."""
    row = variable.row
    texts = [_text(variable.name), _text(_unit(row)), str(variable.place), str(row.size)]
    return [*texts, bound(row.lower), bound(row.upper), str(int(row.whole)), str(_flag(variable, inputs))]


def _flag(variable: Variable, inputs: Mapping[str, Variable]) -> int:
    """Place of the flag of an input (`flag_of`); -1 if there is none or this is not an input."""
    flag = flag_of(variable.row.name, inputs) if variable.kind is Kind.INPUT else None
    return -1 if flag is None else inputs[flag].place


def _unit(row: Row) -> str:
    return "" if row.unit in ("1", "SI") else row.unit


def _text(value: str) -> str:
    return '"' + value.replace("\\", "\\\\").replace('"', '\\"') + '"'


def _lines(items: Sequence[str], width: int = 8) -> list[str]:
    return ["  " + ", ".join(items[i : i + width]) + "," for i in range(0, len(items), width)]
