"""`export_c`: an estimator as plain C in a folder, with its test for this machine and for a board."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from importlib.resources import files
from pathlib import Path

from insenv.base.errors import InputError
from insenv.base.output import as_path, atomic, cannot_write
from insenv.base.shipped import __version__
from insenv.core.portable import KEYWORDS, Portable, c_files, identifier
from insenv.core.tables import Array
from insenv.estimators import Estimator
from insenv.estimators.settings import Settings
from insenv.export.board.figures import WHOLE, Figures, figures
from insenv.export.board.precision import Compiled, run_shares, single_elements, tolerance, worst
from insenv.export.board.tuned import Running, Tuned, tuned
from insenv.logs import RecordedLog
from insenv.scenario import ScenarioLike
from insenv.scenario.inputs import EVERY, SAMPLES

SAMPLES_FILE, RUN = "test/samples.h", "test/run.bin"
LIBRARY = frozenset({"sqrt", "floor", "fabs", "sqrtf", "floorf", "fabsf", "memcpy", "real", "main"})
"""Names of functions and types beside those of the filter."""
_TEMPLATES = {
    "Makefile": "Makefile",
    "CMakeLists.txt": "CMakeLists.txt",
    "main.c": "test/main.c",
    "step_done.h": "test/step_done.h",
    "port.c": "test/port.c",
    "mps2_an500.c": "test/mps2_an500.c",
    "mps2_an500.ld": "test/mps2_an500.ld",
}
"""Hand-written files of `insenv/export/board/c`, and where they go."""


@dataclass(frozen=True)
class BoardFiles:
    """An export: its folder, the C name of the filter, the files in the folder, the numbers of samples with which it can be
    tested, and, where an ARM compiler is installed, its size and time.

    shares: of another precision than double, its largest differences from double over the run, as shares of the stated sigma.
    """

    folder: Path
    name: str
    files: tuple[str, ...]
    samples: int
    run_samples: int
    figures: Figures | None
    shares: Mapping[str, float]


def export_c(
    estimator: Estimator | str,
    source: ScenarioLike | RecordedLog | None = None,
    *,
    output: str | Path,
    name: str | None = None,
    seed: int | None = None,
    duration_s: float | None = None,
    settings: Settings | None = None,
    start: str | None = None,
    precision: str = "double",
    whole_run: bool = False,
    measure: bool = True,
) -> BoardFiles:
    """Write an estimator as C99 for a microcontroller, with a test that its results there are bit-identical.

    Parameters
    ----------
    estimator: an id, or an `Estimator`.
    source: a scenario or a log, by name, path or object: the filter has the states, parameters and start that it has there, and
        the test the inputs of that run.  None: the scenario of the estimator's FMU (docs/fmu.md).
    output: folder to write to; it is made if it is missing.  Files of an earlier export are replaced, no others.
    name: prefix of all names in C; None: the estimator's id.
    seed, duration_s: of the simulated run, s; None: the scenario's.
    settings: parameters by estimator id, as of `insenv.run`.
    start: of a log, as of `insenv.replay`; None: coarse.
    precision: "double"; "mixed": the covariance in single precision; "float32": all but what is summed up over the samples
        (docs/microcontroller.md).  Another than double needs a C compiler here.
    whole_run: whether the whole run is written too (`RUN`, 8 bytes a number), not only its first `SAMPLES` samples.
    measure: whether size, stack and instructions on a Cortex-M7 are measured, where its compiler and qemu are installed.

    Raises `InputError` for an unknown name, a wrong value, an estimator that cannot run there or that smooths, a run of fewer
    than `EVERY` samples, a precision that changes this run too much (`insenv.export.board.precision`), and for a folder that
    cannot be written to or whose files are not those of an export.
    """
    folder = as_path("output", output)
    ready = tuned(estimator, source, seed=seed, duration_s=duration_s, settings=settings, start=start)
    if ready.samples < EVERY:
        raise InputError(f"the run has {ready.samples} samples: allowed are {EVERY} or more, after which outputs are compared")
    c_name = identifier(ready.estimator.id) if name is None else _checked_name(name)
    _check_folder(folder, (f"{c_name}.h", f"{c_name}.c", "README.md", *_TEMPLATES.values()))
    model = ready.estimator.model
    single = single_elements(precision, model)
    portable = Portable(c_name, ready.parameters, ready.dt, ready.values_from, single, tolerance(precision, ready))
    texts = c_files(model, portable)

    def runner() -> Running:
        """The filter in its precision, at its start."""
        return Compiled(in_one(texts, c_name), model, ready.parameters) if single else ready.runner()

    inputs, begin, outputs = ready.first(min(SAMPLES, ready.samples) // EVERY * EVERY, runner())
    shares = run_shares(ready, runner()) if single else {}
    run_samples = ready.samples if whole_run else 0
    samples = _samples(c_name, ready, inputs, begin, outputs[EVERY - 1 :: EVERY])
    texts = {SAMPLES_FILE: samples, **texts}  # the file that marks an export comes first
    for template, place in _TEMPLATES.items():
        texts[place] = filled(template, c_name)
    try:
        (folder / "test").mkdir(parents=True, exist_ok=True)
        for place, text in texts.items():
            with atomic(folder / place) as stream:
                stream.write(text.encode("ascii"))
        if whole_run:
            with atomic(folder / RUN) as stream:
                for part in _records(ready, runner()):
                    stream.write(part)
        else:
            (folder / RUN).unlink(missing_ok=True)
        measured = figures(folder, c_name) if measure else None
        with atomic(folder / "README.md") as stream:
            stream.write(_readme(c_name, ready, measured, precision, shares).encode("ascii"))
    except OSError as error:
        raise cannot_write(Path(error.filename or folder), error) from None
    written = sorted([*texts, "README.md", *([RUN] if whole_run else [])])
    return BoardFiles(folder, c_name, tuple(written), len(inputs), run_samples, measured, shares)


def _checked_name(name: object) -> str:
    if not isinstance(name, str) or not re.fullmatch(r"[A-Za-z]\w*", name, re.ASCII):
        raise InputError(f"name = {name!r}: allowed is a C identifier: letters, digits and '_', a letter first")
    if name in KEYWORDS | LIBRARY:
        raise InputError(f"name = {name!r}: allowed is a name that means nothing in C, C++ or the library that the filter uses")
    return name


def _check_folder(folder: Path, places: Iterable[str]) -> None:
    """Refuse a folder in which files would be replaced that are not those of an export."""
    if folder.exists() and not folder.is_dir():
        raise InputError(f"output {str(folder)!r} is a file: allowed is a folder")
    taken = [place for place in places if (folder / place).exists()]
    if taken and not (folder / SAMPLES_FILE).is_file():
        raise InputError(
            f"output {str(folder)!r} has {', '.join(taken)} and is no earlier export: allowed is a folder without such files"
        )


def filled(template: str, name: str) -> str:
    """The text of a hand-written file for the filter `name`."""
    text = (files("insenv.export.board") / "c" / template).read_text(encoding="utf-8")
    return text.replace("@name@", name).replace("@NAME@", name.upper())


def in_one(texts: Mapping[str, str], name: str) -> str:
    """Source, header and ``c/run.c`` of the filter `name` in one text, for `Compiled`."""
    return (texts[f"{name}.c"] + filled("run.c", name)).replace(f'#include "{name}.h"\n', texts[f"{name}.h"])


def _samples(name: str, ready: Tuned, inputs: Array, begin: Array, outputs: Array) -> str:
    """samples.h: inputs and expected outputs of the first samples as arrays."""
    every, steps = ready.every, ready.estimator.model.steps
    return "\n".join(
        [
            f"/* Inputs of {name} and the outputs that insenv {__version__} computes from them.  {ready.values_from} */",
            f'#include "{name}.h"',
            "",
            f"#define SAMPLES {len(inputs)}",
            f"#define EVERY {EVERY} /* samples from one row of `first_outputs` to the next */",
            f"#define RUN_EVERY {every} /* the same of a whole run */",
            f"#define N_STEP {len(steps)}",
            f"#define STEP_NAMES {{{', '.join(chr(34) + step + chr(34) for step in (*steps, WHOLE))}}}",
            "",
            *_array("outputs_at_start", [begin]),
            *_array("first_inputs", inputs, "SAMPLES"),
            *_array("first_outputs", outputs, "SAMPLES / EVERY"),
            "",
        ]
    )


def _array(name: str, rows: Array | list[Array], length: str = "") -> list[str]:
    lines = [", ".join(repr(float(value)) for value in row) for row in rows]
    if not length:
        return [f"static const double {name}[{len(rows[0])}] = {{{lines[0]}}};"]
    return [f"static const double {name}[{length}][{len(rows[0])}] = {{", *(f"  {{{line}}}," for line in lines), "};"]


def _records(ready: Tuned, runner: Running) -> Iterator[bytes]:
    """The bytes of a whole run: the inputs of `every` samples, then the outputs after them, and so on; little-endian."""
    for inputs, outputs in ready.run(runner):
        for number, row in enumerate(outputs):
            yield (
                inputs[number * ready.every : (number + 1) * ready.every].astype("<f8").tobytes() + row.astype("<f8").tobytes()
            )


def _readme(name: str, ready: Tuned, measured: Figures | None, precision: str, shares: Mapping[str, float]) -> str:
    """README.md: what lies there, how to use it, and what it takes on a Cortex-M7."""
    table = measured.lines() if measured is not None else ["Not measured at the export."]
    table += ["", "## Precision", "", f"{precision}: {worst(shares)}."] if shares else []
    fields: Mapping[str, str] = {
        "title": ready.estimator.title,
        "values_from": ready.values_from,
        "figures": "\n".join(table),
    }
    text = filled("README.md", name)
    for field, value in fields.items():
        text = text.replace(f"@{field}@", value)
    return text.encode("ascii", "replace").decode()
