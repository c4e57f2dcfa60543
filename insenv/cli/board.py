"""The commands `insenv export c` and `insenv check c`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Optional

import typer

from insenv.cli.options import (
    HELP,
    Duration,
    Json,
    OnceCommand,
    Seed,
    Settings,
    changed_log,
    changed_scenario,
    command,
    nonempty_path,
    out_option,
)
from insenv.cli.runs import Start

app = typer.Typer(help="Export a filter as C for a microcontroller.", context_settings=HELP)
checking = typer.Typer(help="Check an exported filter on its board.", context_settings=HELP)


@app.callback()
def group() -> None:
    """Export a filter as C for a microcontroller."""


@app.command("c", cls=OnceCommand)
@command
def export_c(
    estimator: Annotated[str, typer.Argument(metavar="ESTIMATOR", help="An estimator's id.")],
    output: Annotated[Path, out_option("DIR", "Folder to write to.")],
    source: Annotated[
        Optional[str],  # noqa: UP045
        typer.Argument(
            metavar="SCENARIO|LOG",
            help="The filter has the states, parameters and start that it has there, and the test the samples of that run. "
            "By default ship-swaying (alignment) or car-city-drive (navigation).",
        ),
    ] = None,
    name: Annotated[
        Optional[str],  # noqa: UP045
        typer.Option(metavar="NAME", help="Prefix of all names in C; by default the estimator's id."),
    ] = None,
    seed: Seed = None,
    duration: Duration = None,
    settings: Settings = None,
    start: Annotated[
        Start | None,
        typer.Option(help="Of a log: from the log alone (the default), from its reference, or from its \\[initial]."),
    ] = None,
    precision: Annotated[
        str, typer.Option(metavar="NAME", help="double; mixed: the covariance in single precision; float32: nearly all in it.")
    ] = "double",
    whole_run: Annotated[
        bool, typer.Option("--whole-run", help="Write the samples of the whole run too, for the test on the board.")
    ] = False,
    no_figures: Annotated[
        bool, typer.Option("--no-figures", help="Do not measure size, stack and instructions on a Cortex-M7.")
    ] = False,
    as_json: Json = False,
) -> None:
    """Write a filter as C99 without a heap, with a test that its results on a board are bit-identical."""
    from dataclasses import asdict

    from insenv.cli.output import print_answer, working
    from insenv.estimators import get
    from insenv.export.board import export_c as write
    from insenv.export.board.precision import worst
    from insenv.logs.loading import is_log
    from insenv.scenario import USUAL

    subject = USUAL[get(estimator).kind] if source is None else source
    taken, values = changed_log(Path(subject), settings) if is_log(subject) else changed_scenario(subject, settings)
    with working(f"exporting {estimator}"):
        done = write(
            estimator, taken, output=output, name=name, seed=seed, duration_s=duration, settings=values,
            start=start, precision=precision, whole_run=whole_run, measure=not no_figures,
        )  # fmt: skip
    content = {**asdict(done), "folder": str(done.folder)}
    run = f", and of the whole run, {done.run_samples}" if done.run_samples else ""
    lines = [
        f"{done.folder}: {done.name}.h and {done.name}.c, with the inputs and outputs of {done.samples} samples{run}",
        f"make -C {done.folder} runs the test on this machine, make -C {done.folder} board on a Cortex-M7 in qemu",
    ]
    if done.shares:
        lines.append(f"{precision}: {worst(done.shares)}")
    if done.figures is not None:
        lines += ["On a Cortex-M7 (README.md there):", *done.figures.text()]
    print_answer(as_json, content, lines)


@checking.callback()
def check_group() -> None:
    """Check an exported filter on its board."""


@checking.command("c", cls=OnceCommand)
@command
def check_c(
    folder: Annotated[Path, typer.Argument(parser=nonempty_path, metavar="DIR", help="Folder of `insenv export c`.")],
    port: Annotated[str, typer.Option(metavar="PORT", help="tcp:HOST:PORT, or serial:DEVICE[:BAUD] (pyserial).")],
    samples: Annotated[
        Optional[int],  # noqa: UP045
        typer.Option(metavar="N", min=1, help="At most so many samples; by default all that the folder has."),
    ] = None,
    as_json: Json = False,
) -> int:
    """Feed a filter on a board with the samples of its export, and compare the outputs to the bit."""
    from dataclasses import asdict

    from insenv.cli.output import print_answer, working
    from insenv.export.board import check_c as check

    with working(f"checking {folder}") as progress:
        done = check(folder, port, samples=samples, progress=progress)
    lines = [f"{port}: {done.samples} samples, {done.compared} numbers compared, {done.differing} differ"]
    if done.first is not None:
        sample, place, value, expected = done.first
        lines.append(f"first: output {place} after {sample} samples is {value!r}, expected {expected!r}")
    print_answer(as_json, asdict(done), lines)
    return int(done.differing > 0)
