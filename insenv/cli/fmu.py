"""The commands `insenv fmu export`, `insenv fmu ssp` and `insenv fmu run`."""

from __future__ import annotations

import json
import math
import textwrap
from collections.abc import Sequence
from enum import Enum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Optional

import typer

from insenv.base.errors import InputError
from insenv.cli.options import HELP, Estimator, Json, Scenario, Seed, command, given_path, one

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
MOST_ELEMENTS, MOST_VARIABLES, MOST_IN_LINE = 20, 12, 4
"""Outputs that are shown: elements, one a line; of more, variables, and elements of a variable."""


class Version(str, Enum):
    """Versions of FMI."""

    two = "2"
    three = "3"


@app.command("export")
@command
def export_fmu(
    subject: Annotated[
        str, typer.Argument(metavar="ID|SCENARIO", help="An estimator's id, or a scenario, whose plant is exported.")
    ],
    output: Annotated[Path, typer.Option("--output", "-o", parser=given_path, metavar="X.fmu", help="File to write.")],
    estimator: Annotated[
        Optional[list[str]],  # noqa: UP045
        typer.Option(
            "--estimator", "-e", metavar="ID", help="With a scenario: put this estimator behind its plant, in one FMU."
        ),
    ] = None,
    fmi: Annotated[Version, typer.Option(help="FMI version: 2.0 has scalars, 3.0 arrays.")] = Version.two,
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
    from insenv.cli.output import print_json, print_line, working
    from insenv.estimators.settings import FILE
    from insenv.fmu import export_fmu as write
    from insenv.fmu.exporter import summary

    names, settings, behind = _platforms(platform), _settings(set_, texts=(FILE,)), one(estimator)
    with working(f"exporting {subject}"):
        write(subject, output, estimator=behind, fmi=int(fmi.value), arrays=arrays, platforms=names, settings=settings)
    content = summary(output)
    if as_json:
        print_json(content)
        return
    print_line(f"{output}: {content['model']}, FMI {content['fmi']}, {content['bytes'] / 1000:.0f} kB")
    counts = ", ".join(f"{count} {what}" for what, count in content["variables"].items())
    print_line(f"variables: {counts}; sample interval {content['sample_interval_s']:g} s")
    print_line(f"binaries: {', '.join(content['binaries'])}")


@app.command("ssp")
@command
def ssp(
    scenario: Scenario,
    estimator: Estimator,
    output: Annotated[Path, typer.Option("--output", "-o", parser=given_path, metavar="X.ssp", help="File to write.")],
    seed: Seed = None,
    fmi: Annotated[Version, typer.Option(help="FMI version of the two FMUs, which have scalars in both.")] = Version.two,
    platform: Platforms = None,
    as_json: Json = False,
) -> None:
    """Write a scenario's plant and an estimator, connected, as an SSP file of two FMUs."""
    from insenv.cli.output import print_json, print_line, working
    from insenv.fmu import export_ssp

    id = one(estimator) or ""
    with working(f"exporting {scenario} and {id}"):
        made = export_ssp(scenario, id, output, seed=seed, fmi=int(fmi.value), platforms=_platforms(platform))
    if as_json:
        print_json({"written": str(output), **made})
        return
    print_line(f"{output}: {scenario} and {id}, {output.stat().st_size / 1000:.0f} kB")
    print_line(f"{made['connections']} connections; steps of {made['step_s']:g} s, up to {made['stop_time_s']:g} s")


@app.command("run")
@command
def run(
    fmu: Annotated[
        Path,
        typer.Argument(
            parser=given_path, metavar="X.fmu|X.ssp", help="An FMU for Co-Simulation, FMI 2 or 3, or an SSP file of FMUs."
        ),
    ],
    input_: Annotated[
        Optional[Path],  # noqa: UP045
        typer.Option(
            "--input",
            parser=given_path,
            metavar="CSV",
            help="Inputs: a column `time`, s, and one for each element of an input.",
        ),
    ] = None,
    output: Annotated[
        Optional[Path],  # noqa: UP045
        typer.Option("--output", "-o", parser=given_path, metavar="CSV", help="Write the outputs there."),
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
    from insenv.cli.output import print_json, print_line, working
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
    with working(fmu.name) as progress:
        if is_system:
            found = run_ssp(fmu, parameters=parameters, step=step, stop_time=stop, every=every, progress=progress)
        else:
            found = run(fmu, inputs, parameters=parameters, step=step, stop_time=stop, every=every, progress=progress)
    if output is not None:
        write_csv(output, found)
    if found.ended:
        print_line(f"insenv: {fmu} ended the simulation at {found.steps * found.step:g} s", stderr=True)
    if not found.steps:
        raise InputError(f"{fmu} ended the simulation in its first step")
    for line in _health(found):
        print_line(f"insenv: {line}", stderr=True)
    time_s, us_per_step = float(found.time[-1]), found.seconds / found.steps * 1e6
    last = dict(zip(found.names, found.values[-1].tolist(), strict=True))
    if as_json:
        counts = {"fmu": str(fmu), "steps": found.steps, "step_s": found.step, "us_per_step": us_per_step, "ended": found.ended}
        columns = {"passed_over": found.passed_over, "held": found.held}
        written = None if output is None else str(output)
        print_json({**counts, **columns, "time_s": time_s, "outputs": last, "written": written})
        return
    for label, names in (("columns that are not inputs", found.passed_over), ("inputs without a column", found.held)):
        if names:
            print_line(f"insenv: {label}: {some(names)}", stderr=True)
    print_line(f"{found.steps} steps of {found.step:g} s, {us_per_step:.2f} us per step")
    if output is not None:
        print_line(f"written: {output}, {len(found.time)} rows of {len(found.names)} outputs")
        return
    print_line(f"outputs at {time_s:g} s (--output CSV writes all):")
    for line in last_outputs(found):
        print_line(f"  {line}")


def _health(found: Outputs) -> list[str]:
    """What must be said of a filter whose innovations are larger than stated; none for another FMU."""
    import numpy as np

    from insenv.estimators.parts.rows import FIX_HEALTH, reported_aids
    from insenv.evaluation.health import WRONG, health

    rows = {name.removeprefix("estimator."): values for name, values in found.named().items()}  # behind a plant too
    if not np.isfinite(found.values).all():
        return [f"outputs are no longer finite from {found.time[~np.isfinite(found.values).all(axis=1)][0]:g} s on. {_START}"]
    if not (set(FIX_HEALTH.names) <= set(rows) or reported_aids(rows)):
        return []
    judged = health(rows)
    if judged is None or judged.verdict not in WRONG:
        return []
    return [f"health: {judged.lines[0]}", *judged.notes(models_slow_errors=True), *([_START] if judged.apart else [])]


_START = (
    "The FMU starts from its parameters (parameters.start_latitude, parameters.start_heading, ...): --set NAME=VALUE sets them"
)


def last_outputs(found: Outputs) -> list[str]:
    """The last outputs on at most a screen: an element a line; if there are many, a variable a line, and the rest by name.

    Those of the end of the data, of an estimator behind a plant, come last in `found` and are shown.
    """
    cells = [
        (name, f"{value:.9g}", found.units[name]) for name, value in zip(found.names, found.values[-1].tolist(), strict=True)
    ]
    rest: list[str] = []
    if len(cells) > MOST_ELEMENTS:
        whole = {name: (values[-1], next(u for e, u in found.units.items() if e.partition("[")[0] == name))
                 for name, values in found.named().items()}  # fmt: skip
        small = [name for name, (value, _) in whole.items() if value.size <= MOST_IN_LINE][-MOST_VARIABLES:]
        cells = [(name, "  ".join(f"{x:.5g}" for x in whole[name][0].ravel().tolist()), whole[name][1]) for name in small]
        rest = [name for name in whole if name not in small]
    width = max((len(name) for name, _, _ in cells), default=0)
    lines = [f"{name:<{width}}  {value} {'' if unit == '1' else unit}".rstrip() for name, value, unit in cells]
    return lines + (textwrap.wrap(f"not shown: {', '.join(rest)}", 78, break_on_hyphens=False) if rest else [])


def _platforms(given: Sequence[str] | None) -> list[str]:
    """The names in options that may each hold several, separated by commas; "host" if there are none."""
    return [name.strip() for option in given or () for name in option.split(",")] or ["host"]


def _scalars(given: Sequence[str] | None) -> dict[str, float]:
    """Finite numbers by name from NAME=VALUE.  Raises `InputError`."""
    scalars: dict[str, float] = {}
    for name, value in _settings(given).items():
        if not (isinstance(value, (bool, float)) and math.isfinite(value)):
            raise InputError(f"--set {name}: allowed is one finite number, or true or false for a Boolean")
        scalars[name] = value
    return scalars


def _list(text: str, value: str) -> list[object]:
    """A list of numbers or of names, such as ``["gnss", "odometer"]``.  Raises `InputError`."""
    try:
        found = json.loads(value)
    except ValueError:
        found = None
    if not isinstance(found, list):
        raise InputError(f'--set {text!r}: {value!r} is no list: allowed is [1, 2, 3] or ["NAME", "NAME"]')
    return found


def _settings(given: Sequence[str] | None, texts: Sequence[str] = ()) -> dict[str, object]:
    """Numbers, lists of numbers, true and false, and for the names in `texts` text, by name from NAME=VALUE.

    A list may also stand in brackets, and then hold names.  Raises `InputError`.
    """
    settings: dict[str, object] = {}
    for text in given or ():
        name, equals, value = (part.strip() for part in text.partition("="))
        if not (name and equals and value):
            raise InputError(f"--set {text!r}: allowed is NAME=VALUE or NAME=VALUE,VALUE,...")
        if name in settings:
            raise InputError(f"--set {name} is given twice")
        if name in texts:
            settings[name] = value
            continue
        if value.startswith("["):
            settings[name] = _list(text, value)
            continue
        if value.lower() in BOOLEANS:
            settings[name] = BOOLEANS[value.lower()]
            continue
        try:
            numbers = [float(number) for number in value.split(",")]
        except ValueError:
            raise InputError(f'--set {text!r}: {value!r} is not a number, or a list such as 1,2,3 or ["NAME"]') from None
        settings[name] = numbers[0] if len(numbers) == 1 else numbers
    return settings
