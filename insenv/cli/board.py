"""The command `insenv export c`."""

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
    out_option,
)
from insenv.cli.runs import Start

app = typer.Typer(help="Export a filter as C for a microcontroller.", context_settings=HELP)


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
            help="The filter has the states, parameters and start that it has there, and the test the samples of that run.",
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
        Start, typer.Option(help="Of a log: from the log alone, from the state of its reference, or from its \\[initial].")
    ] = Start.coarse,
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

    from insenv.board import export_c as write
    from insenv.cli.output import print_answer, working
    from insenv.estimators import get
    from insenv.logs.loading import is_log
    from insenv.scenario import USUAL

    given = USUAL[get(estimator).kind] if source is None else source
    taken, values = changed_log(Path(given), settings) if is_log(given) else changed_scenario(given, settings)
    with working(f"exporting {estimator}"):
        done = write(
            estimator, taken, output=output, name=name, seed=seed, duration_s=duration, settings=values, start=start.value,
            whole_run=whole_run, measure=not no_figures,
        )  # fmt: skip
    content = {**asdict(done), "folder": str(done.folder)}
    run = f", and of the whole run, {done.run_samples}" if done.run_samples else ""
    lines = [
        f"{done.folder}: {done.name}.h and {done.name}.c, with the inputs and outputs of {done.samples} samples{run}",
        f"make -C {done.folder} runs the test on this machine, make -C {done.folder} board on a Cortex-M7 in qemu",
    ]
    if done.figures is not None:
        lines += ["On a Cortex-M7 (README.md there):", *done.figures.text()]
    print_answer(as_json, content, lines)
