"""The commands ``insenv fmu ...``: estimators and plants as FMUs."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from enum import Enum
from functools import partial
from pathlib import Path
from typing import Annotated, Optional

import typer

Work = Callable[[], None]

app = typer.Typer(
    help="Export estimators and plants as FMUs for co-simulation.", context_settings={"help_option_names": ["-h", "--help"]}
)

Platforms = Annotated[
    Optional[list[str]],  # noqa: UP045 - older versions of typer read no unions
    typer.Option(
        "--platform",
        metavar="P[,P...]",
        help="host, all, linux64, aarch64-linux, win64, darwin64; may be given more than once. All but host need ziglang.",
    ),
]
Json = Annotated[bool, typer.Option("--json", help="Print one JSON document on stdout and nothing else.")]


class Version(str, Enum):
    """The versions of FMI that are written."""

    two = "2"
    three = "3"


@app.command("export")
def export(
    subject: Annotated[str, typer.Argument(metavar="ID|SCENARIO", help="An estimator's id, or a scenario: its plant.")],
    output: Annotated[Path, typer.Option("--output", "-o", metavar="X.fmu", help="The file to write.")],
    fmi: Annotated[Version, typer.Option(help="Version of FMI: 2.0 with scalars, 3.0 with arrays.")] = Version.two,
    platform: Platforms = None,
    set_: Annotated[
        Optional[list[str]],  # noqa: UP045
        typer.Option(
            "--set", metavar="NAME=VALUE", help="Start value of a parameter, a list as 1,2,3; SI, or as in a scenario."
        ),
    ] = None,
    json: Json = False,
) -> Work:
    """Write an estimator, or a scenario's plant, as an FMU for Co-Simulation."""
    return partial(_export, subject, output, fmi=int(fmi.value), platforms=platform or [], set_=set_ or [], as_json=json)


@app.command("ssp")
def ssp(
    scenario: Annotated[str, typer.Argument(metavar="SCENARIO", help="A name that `insenv list` shows, or a .toml file.")],
    estimator: Annotated[str, typer.Option("--estimator", "-e", metavar="ID", help="The estimator on what its sensors show.")],
    output: Annotated[Path, typer.Option("--output", "-o", metavar="X.ssp", help="The file to write.")],
    seed: Annotated[Optional[int], typer.Option(metavar="N", help="Instead of the scenario's seed.")] = None,  # noqa: UP045
    platform: Platforms = None,
    json: Json = False,
) -> Work:
    """Write a scenario's plant and an estimator, connected, as an SSP file of two FMUs."""
    return partial(_ssp, scenario, estimator, output, seed=seed, platforms=platform or [], as_json=json)


@app.command("run")
def run(
    fmu: Annotated[
        Path, typer.Argument(metavar="X.fmu", help="An FMU for Co-Simulation, FMI 2 or 3, of insenv or another tool.")
    ],
    input_: Annotated[
        Optional[Path],  # noqa: UP045
        typer.Option("--input", metavar="CSV", help="Inputs: a column `time`, s, and one for each element of an input."),
    ] = None,
    output: Annotated[Optional[Path], typer.Option("--output", "-o", metavar="CSV", help="Write the outputs there.")] = None,  # noqa: UP045
    step: Annotated[
        Optional[float],  # noqa: UP045
        typer.Option(metavar="S", help="Communication step in seconds, instead of the FMU's own."),
    ] = None,
    stop: Annotated[
        Optional[float],  # noqa: UP045
        typer.Option(metavar="S", help="Stop time in seconds; without --input the default is the FMU's own."),
    ] = None,
    every: Annotated[int, typer.Option(metavar="N", help="Record the outputs after every N steps.")] = 1,
    set_: Annotated[
        Optional[list[str]],  # noqa: UP045
        typer.Option("--set", metavar="NAME=VALUE", help="Value of a scalar parameter; may be given more than once."),
    ] = None,
    json: Json = False,
) -> Work:
    """Run an FMU over sampled inputs; print or write its outputs."""
    return partial(_run, fmu, input_, output, step=step, stop=stop, every=every, set_=set_ or [], as_json=json)


def platforms_of(given: Sequence[str]) -> list[str]:
    """The names in options that may hold several, parted by commas; "host" if there are none."""
    return [name.strip() for option in given for name in option.split(",")] or ["host"]


def _export(subject: str, output: Path, *, fmi: int, platforms: Sequence[str], set_: Sequence[str], as_json: bool) -> None:
    from insenv.cli.output import print_json, print_line, quiet_warnings, working
    from insenv.fmu.exporter import export as write
    from insenv.fmu.exporter import summary

    names, settings = platforms_of(platforms), _settings(set_)
    with quiet_warnings(), working(f"exporting {subject}"):
        write(subject, output, fmi=fmi, platforms=names, settings=settings)
    told = summary(output)
    if as_json:
        print_json(told)
        return
    print_line(f"{output}: {told['model']}, FMI {told['fmi']}, {told['bytes'] / 1000:.0f} kB")
    counts = ", ".join(f"{count} {what}" for what, count in told["variables"].items())
    print_line(f"variables: {counts}; sample interval {told['sample_interval_s']:g} s")
    print_line(f"binaries: {', '.join(told['binaries'])}")


def _ssp(scenario: str, estimator: str, output: Path, *, seed: int | None, platforms: Sequence[str], as_json: bool) -> None:
    from insenv.cli.output import print_json, print_line, quiet_warnings, working
    from insenv.fmu.ssp import export_ssp

    with quiet_warnings(), working(f"exporting {scenario} and {estimator}"):
        made = export_ssp(scenario, estimator, output, seed=seed, platforms=platforms_of(platforms))
    if as_json:
        print_json({"written": str(output), **made})
        return
    print_line(f"{output}: {scenario} and {estimator}, {output.stat().st_size / 1000:.0f} kB")
    print_line(f"{made['connections']} connections; steps of {made['step_s']:g} s, up to {made['stop_time_s']:g} s")


def _run(
    fmu: Path,
    input_: Path | None,
    output: Path | None,
    *,
    step: float | None,
    stop: float | None,
    every: int,
    set_: Sequence[str],
    as_json: bool,
) -> None:
    from insenv.cli.output import print_json, print_line, quiet_warnings, working
    from insenv.files.output import check_output_file
    from insenv.fmu.running import run, some
    from insenv.fmu.series import read_csv, write_csv

    parameters = _scalars(set_)
    if output is not None:
        check_output_file(output)
    inputs = None if input_ is None else read_csv(input_)
    with quiet_warnings(), working(fmu.name) as progress:
        found = run(fmu, inputs, parameters=parameters, step=step, stop_time=stop, every=every, progress=progress)
    if output is not None:
        write_csv(output, found)
    time_s, us_per_step = float(found.time[-1]), found.seconds / found.steps * 1e6
    last = dict(zip(found.names, found.values[-1].tolist(), strict=True))
    if as_json:
        print_json(
            {"fmu": str(fmu), "steps": found.steps, "step_s": found.step, "us_per_step": us_per_step,
             "passed_over": found.passed_over, "held": found.held, "time_s": time_s, "outputs": last,
             "written": None if output is None else str(output)}
        )  # fmt: skip
        return
    for label, names in (("columns that are not inputs", found.passed_over), ("inputs without a column", found.held)):
        if names:
            print_line(f"insenv: {label}: {some(names)}", stderr=True)
    print_line(f"{found.steps} steps of {found.step:g} s, {us_per_step:.2f} us per step")
    if output is not None:
        print_line(f"written: {output}, {len(found.time)} rows of {len(found.names)} outputs")
        return
    width = max(map(len, last), default=0)
    print_line(f"outputs at {time_s:g} s (--output CSV writes all):")
    for name, value in last.items():
        unit = "" if found.units[name] == "1" else found.units[name]
        print_line(f"  {name:<{width}}  {value:.9g} {unit}".rstrip())


def _scalars(given: Sequence[str]) -> dict[str, float]:
    """One finite number by name, from NAME=VALUE.  Raises `InputError`."""
    from insenv.errors import InputError

    settings: dict[str, float] = {}
    for name, value in _settings(given).items():
        if not (isinstance(value, float) and math.isfinite(value)):
            raise InputError(f"--set {name}: allowed is one finite number")
        settings[name] = value
    return settings


def _settings(given: Sequence[str]) -> dict[str, object]:
    """Values by name from NAME=VALUE.  Raises `InputError` for what is not of that form."""
    from insenv.errors import InputError
    from insenv.scenario.tuning import FILE

    settings: dict[str, object] = {}
    for text in given:
        name, equals, value = (part.strip() for part in text.partition("="))
        if not (name and equals and value):
            raise InputError(f"--set {text!r}: allowed is NAME=VALUE or NAME=VALUE,VALUE,...")
        if name in settings:
            raise InputError(f"--set {name} is given twice")
        if name == FILE:
            settings[name] = value
            continue
        try:
            numbers = [float(number) for number in value.split(",")]
        except ValueError:
            raise InputError(f"--set {text!r}: {value!r} is not a number, or numbers parted by commas") from None
        settings[name] = numbers[0] if len(numbers) == 1 else numbers
    return settings
