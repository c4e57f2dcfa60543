"""The commands `insenv fmu export`, `insenv fmu ssp` and `insenv fmu run`."""

from __future__ import annotations

import json
import math
import textwrap
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal, Optional

import typer

from insenv.base.errors import InputError
from insenv.cli.options import HELP, Estimator, Json, OnceCommand, Scenario, Seed, command, nonempty_path, one, out_option

if TYPE_CHECKING:
    from insenv.fmu.running import Outputs

app = typer.Typer(help="Export estimators and plants as FMUs for co-simulation, and run FMUs.", context_settings=HELP)

Platforms = Annotated[
    Optional[list[str]],  # noqa: UP045
    typer.Option(
        "--platform",
        metavar="P[,P...]",
        help="host, all, linux64, aarch64-linux, win64, darwin64; may be given more than once. All but host need ziglang.",
    ),
]


BOOLEANS = {"true": True, "false": False}
MAX_ELEMENTS, MAX_VARIABLES, MAX_IN_LINE = 20, 12, 4
"""Outputs that are printed: elements, one a line; of more, variables, and elements of a variable."""


Version = Literal["2", "3"]
"""Versions of FMI."""


@app.command("export", cls=OnceCommand)
@command
def export_fmu(
    subject: Annotated[
        str, typer.Argument(metavar="ID|SCENARIO", help="An estimator's id, or a scenario, whose plant is exported.")
    ],
    output: Annotated[Path, out_option("X.fmu", "File to write.")],
    estimator: Annotated[
        Optional[list[str]],  # noqa: UP045
        typer.Option(
            "--estimator", "-e", metavar="ID", help="With a scenario: put this estimator behind its plant, in one FMU."
        ),
    ] = None,
    fmi: Annotated[Version, typer.Option(help="FMI version: 2.0 has scalars, 3.0 arrays.")] = "2",
    arrays: Annotated[
        Optional[bool],  # noqa: UP045
        typer.Option("--arrays/--no-arrays", help="FMI 3: vectors as arrays (the default), or a scalar for each element."),
    ] = None,
    platform: Platforms = None,
    set_: Annotated[
        Optional[list[str]],  # noqa: UP045
        typer.Option(
            "--set",
            metavar="NAME=VALUE",
            help="Start value of a parameter; a list as 1,2,3; a Boolean as true or false. SI units, or as in a scenario. "
            'States and aids of fusion: aids=["gnss"].',
        ),
    ] = None,
    as_json: Json = False,
) -> None:
    """Write an estimator, a scenario's plant, or both in one, as an FMU for Co-Simulation."""
    from insenv.cli.output import print_answer, working
    from insenv.estimators.settings import FILE
    from insenv.fmu import export_fmu as write
    from insenv.fmu.exporter import summary

    names, settings, behind = _platforms(platform), _settings(set_, files=(FILE,)), one(estimator)
    with working(f"exporting {subject}"):
        write(subject, output, estimator=behind, fmi=int(fmi), arrays=arrays, platforms=names, settings=settings)
    content = summary(output)
    counts = ", ".join(f"{count} {what}" for what, count in content["variables"].items())
    lines = [
        f"{output}: {content['model']}, FMI {content['fmi']}, {content['bytes'] / 1000:.0f} kB",
        f"variables: {counts}; sample interval {content['sample_interval_s']:g} s",
        f"binaries: {', '.join(content['binaries'])}",
    ]
    print_answer(as_json, content, lines)


@app.command("ssp", cls=OnceCommand)
@command
def ssp(
    scenario: Scenario,
    estimator: Estimator,
    output: Annotated[Path, out_option("X.ssp", "File to write.")],
    seed: Seed = None,
    fmi: Annotated[Version, typer.Option(help="FMI version of the two FMUs, which have scalars in both.")] = "2",
    platform: Platforms = None,
    as_json: Json = False,
) -> None:
    """Write a scenario's plant and an estimator, connected, as an SSP file of two FMUs."""
    from insenv.cli.output import print_answer, working
    from insenv.fmu import export_ssp

    id = one(estimator) or ""
    with working(f"exporting {scenario} and {id}"):
        made = export_ssp(scenario, id, output, seed=seed, fmi=int(fmi), platforms=_platforms(platform))
    lines = [
        f"{output}: {scenario} and {id}, {output.stat().st_size / 1000:.0f} kB",
        f"{made['connections']} connections; steps of {made['step_s']:g} s, up to {made['stop_time_s']:g} s",
    ]
    print_answer(as_json, {"written": str(output), **made}, lines)


@app.command("run", cls=OnceCommand)
@command
def run(
    fmu: Annotated[
        Path,
        typer.Argument(
            parser=nonempty_path, metavar="X.fmu|X.ssp", help="An FMU for Co-Simulation, FMI 2 or 3, or an SSP file of FMUs."
        ),
    ],
    input_: Annotated[
        Optional[Path],  # noqa: UP045
        typer.Option(
            "--input",
            parser=nonempty_path,
            metavar="CSV",
            help="Inputs: a column `time`, s, and one for each element of an input.",
        ),
    ] = None,
    output: Annotated[
        Optional[Path],  # noqa: UP045
        out_option("CSV", "Write the outputs there."),
    ] = None,
    step: Annotated[
        Optional[float],  # noqa: UP045
        typer.Option(metavar="S", help="Communication step in seconds; replaces the FMU's own."),
    ] = None,
    stop: Annotated[
        Optional[float],  # noqa: UP045
        typer.Option(metavar="S", help="Stop time in seconds; without --input the default is the FMU's own."),
    ] = None,
    every: Annotated[int, typer.Option(metavar="N", help="Record the outputs after every N steps.")] = 1,
    set_: Annotated[
        Optional[list[str]],  # noqa: UP045
        typer.Option("--set", metavar="NAME=VALUE", help="Value of a scalar parameter, true or false for a Boolean."),
    ] = None,
    as_json: Json = False,
) -> None:
    """Run an FMU over sampled inputs, or the FMUs of an SSP file; print or write the outputs."""
    from insenv.base.output import check_output_file
    from insenv.cli.output import print_answer, print_line, working
    from insenv.fmu.reading import switched_inputs
    from insenv.fmu.running import read_csv, run, some, write_csv
    from insenv.fmu.system import run_ssp

    parameters = _scalars(set_)
    if output is not None:
        check_output_file(output)
    is_system = fmu.suffix == ".ssp"
    if is_system and input_ is not None:
        raise InputError(f"--input with {fmu}: an SSP file takes no inputs; --input is allowed with an .fmu file")
    inputs = None if input_ is None else read_csv(input_, switched_inputs(fmu))
    options: dict[str, Any] = {"parameters": parameters, "step": step, "stop_time": stop, "every": every}
    with working(fmu.name) as progress:
        outputs = run_ssp(fmu, **options, progress=progress) if is_system else run(fmu, inputs, **options, progress=progress)
    if output is not None:
        write_csv(output, outputs)
    steps = outputs.steps
    if outputs.ended:
        print_line(f"insenv: {fmu} ended the simulation at {steps * outputs.step:g} s", stderr=True)
    if not steps:
        raise InputError(f"{fmu} ended the simulation in its first step")
    for line in _health(outputs):
        print_line(f"insenv: {line}", stderr=True)
    time_s, us_per_step = float(outputs.time[-1]), outputs.seconds / steps * 1e6
    values = {
        "fmu": str(fmu), "steps": steps, "step_s": outputs.step, "us_per_step": us_per_step, "ended": outputs.ended,
        "passed_over": outputs.passed_over, "held": outputs.held, "time_s": time_s,
        "outputs": dict(zip(outputs.names, outputs.values[-1].tolist(), strict=True)),
        "written": None if output is None else str(output),
    }  # fmt: skip
    for label, names in (("columns that are not inputs", outputs.passed_over), ("inputs without a column", outputs.held)):
        if names and not as_json:
            print_line(f"insenv: {label}: {some(names)}", stderr=True)
    lines = [f"{steps} steps of {outputs.step:g} s, {us_per_step:.2f} us per step"]
    if output is not None:
        lines.append(f"written: {output}, {len(outputs.time)} rows of {len(outputs.names)} outputs")
    else:
        lines.append(f"outputs at {time_s:g} s (--output CSV writes all):")
        lines += [f"  {line}" for line in last_outputs(outputs)]
    print_answer(as_json, values, lines)


def _health(outputs: Outputs) -> list[str]:
    """Remarks on a filter whose innovations are larger than stated; none for another FMU."""
    import numpy as np

    from insenv.estimators.parts.rows import FIX_HEALTH, reported_aids
    from insenv.evaluation.health import WRONG, health

    rows = {name.removeprefix("estimator."): values for name, values in outputs.named().items()}  # behind a plant too
    finite = np.isfinite(outputs.values).all(axis=1)
    if not finite.all():
        return [f"outputs are no longer finite from {outputs.time[~finite][0]:g} s on. {_START}"]
    if not (set(FIX_HEALTH.names) <= set(rows) or reported_aids(rows)):
        return []
    judged = health(rows)
    if judged is None or judged.verdict not in WRONG:
        return []
    return [f"health: {judged.lines[0]}", *judged.notes(models_slow_errors=True), *([_START] if judged.apart else [])]


_START = (
    "The FMU starts from its parameters (parameters.start_latitude, parameters.start_heading, ...): --set NAME=VALUE sets them"
)


def last_outputs(outputs: Outputs) -> list[str]:
    """The last outputs on at most a screen: an element a line; if there are many, a variable a line, and the rest by name.

    Those of the end of the data, of an estimator behind a plant, come last in `outputs` and are printed.
    """
    last = outputs.values[-1].tolist()
    cells = [(name, f"{value:.9g}", outputs.units[name]) for name, value in zip(outputs.names, last, strict=True)]
    rest: list[str] = []
    if len(cells) > MAX_ELEMENTS:
        units = {name.partition("[")[0]: unit for name, unit in outputs.units.items()}
        variables = {name: values[-1].ravel().tolist() for name, values in outputs.named().items()}
        small = [name for name, values in variables.items() if len(values) <= MAX_IN_LINE][-MAX_VARIABLES:]
        cells = [(name, "  ".join(f"{x:.5g}" for x in variables[name]), units[name]) for name in small]
        rest = [name for name in variables if name not in small]
    width = max((len(name) for name, _, _ in cells), default=0)
    lines = [f"{name:<{width}}  {value} {'' if unit == '1' else unit}".rstrip() for name, value, unit in cells]
    return lines + (textwrap.wrap(f"not shown: {', '.join(rest)}", 78, break_on_hyphens=False) if rest else [])


def _platforms(options: Sequence[str] | None) -> list[str]:
    """The names in options that may each hold several, separated by commas; "host" if there are none."""
    return [name.strip() for option in options or () for name in option.split(",")] or ["host"]


def _scalars(texts: Sequence[str] | None) -> dict[str, float]:
    """Finite numbers by name from NAME=VALUE.  Raises `InputError`."""
    scalars: dict[str, float] = {}
    for name, value in _settings(texts).items():
        if not (isinstance(value, (bool, float)) and math.isfinite(value)):
            raise InputError(f"--set {name}: allowed is one finite number, or true or false for a Boolean")
        scalars[name] = value
    return scalars


def _settings(texts: Sequence[str] | None, files: Sequence[str] = ()) -> dict[str, object]:
    """Numbers, lists of numbers or of names, true and false by name from NAME=VALUE; text for the names in `files`.

    Raises `InputError`.
    """
    settings: dict[str, object] = {}
    for text in texts or ():
        name, equals, value = (part.strip() for part in text.partition("="))
        if not (name and equals and value):
            raise InputError(f"--set {text!r}: allowed is NAME=VALUE or NAME=VALUE,VALUE,...")
        if name in settings:
            raise InputError(f"--set {name} is given twice")
        settings[name] = value if name in files else _value(text, value)
    return settings


def _value(text: str, value: str) -> object:
    """The value of a setting; text: the whole, for the message of an `InputError`."""
    if value.startswith("["):
        try:
            items = json.loads(value)
        except ValueError:
            items = None
        if not isinstance(items, list):
            raise InputError(f'--set {text!r}: {value!r} is not a list: allowed is [1, 2, 3] or ["NAME", "NAME"]')
        return items
    if value.lower() in BOOLEANS:
        return BOOLEANS[value.lower()]
    try:
        numbers = [float(number) for number in value.split(",")]
    except ValueError:
        raise InputError(f'--set {text!r}: {value!r} is not a number, or a list such as 1,2,3 or ["NAME"]') from None
    return numbers[0] if len(numbers) == 1 else numbers
