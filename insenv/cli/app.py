"""The command line's grammar: each command gives the work to be done, which `insenv.cli.main` then does."""

from __future__ import annotations

from collections.abc import Callable
from enum import Enum
from functools import partial
from pathlib import Path
from typing import Annotated, Optional

import typer

from insenv.cli import commands

Work = Callable[[], None]

app = typer.Typer(
    add_completion=False,
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"]},
    help="Simulate vehicles with inertial sensors, and align and navigate them.",
    epilog="Exit status: 0 done, 1 the work failed, 2 the call was wrong, 130 interrupted.",
)

Json = Annotated[bool, typer.Option("--json", help="Print one JSON document on stdout and nothing else.")]
Out = Annotated[
    Optional[Path],  # noqa: UP045 - older versions of typer read no unions
    typer.Option("--out", "-o", metavar="DIR", help="Write the results (.npz, .json) and the figure (.png, .svg) there."),
]
NoFigure = Annotated[bool, typer.Option("--no-figure", help="With --out: write no figure.")]
Estimators = Annotated[
    Optional[list[str]],  # noqa: UP045
    typer.Option("--estimator", "-e", metavar="ID", help="Estimator to run; may be given more than once."),
]


class Start(str, Enum):
    """How a replay starts."""

    coarse = "coarse"
    reference = "reference"


@app.callback(invoke_without_command=True)
def root(
    context: typer.Context,
    version: Annotated[bool, typer.Option("--version", help="Print the version and exit.", is_eager=True)] = False,
) -> None:
    if version:
        from insenv import __version__

        print(f"insenv {__version__}")
        raise typer.Exit(0)
    if context.invoked_subcommand is None:
        print(context.get_help())
        raise typer.Exit(2)


@app.command("list")
def list_(json: Json = False) -> Work:
    """List the scenarios, estimators and sensor grades."""
    return partial(commands.list_all, as_json=json)


@app.command()
def run(
    scenario: Annotated[str, typer.Argument(metavar="SCENARIO", help="A name that `insenv list` shows, or a .toml file.")],
    estimator: Estimators = None,
    seed: Annotated[Optional[int], typer.Option(metavar="N", help="Instead of the scenario's seed.")] = None,  # noqa: UP045
    duration: Annotated[
        Optional[float],  # noqa: UP045
        typer.Option(metavar="S", help="Seconds, instead of the scenario's."),
    ] = None,
    out: Out = None,
    no_figure: NoFigure = False,
    json: Json = False,
) -> Work:
    """Simulate a scenario and run estimators on it; print every error beside its theoretical limit."""
    return partial(
        commands.run,
        scenario,
        estimator or [],
        seed=seed,
        duration_s=duration,
        out=out,
        figure=not no_figure,
        as_json=json,
    )


@app.command()
def replay(
    log: Annotated[Path, typer.Argument(metavar="LOG.toml", help="Description of a recorded log (docs/logs.md).")],
    estimator: Estimators = None,
    start: Annotated[Start, typer.Option(help="Start from the log alone, or from the state of its reference.")] = Start.coarse,
    out: Out = None,
    no_figure: NoFigure = False,
    json: Json = False,
) -> Work:
    """Run a recorded log through estimators; print the errors against its reference."""
    if not estimator:
        raise typer.BadParameter("name an estimator with -e ID; `insenv list` shows them")
    return partial(commands.replay, log, estimator, start=start.value, out=out, figure=not no_figure, as_json=json)


@app.command()
def bench(
    only: Annotated[Optional[str], typer.Option(metavar="PREFIX", help="Only figures whose name begins so.")] = None,  # noqa: UP045
    json: Json = False,
) -> Work:
    """Measure speed and accuracy on this machine, each figure beside its floor."""
    return partial(commands.bench, only, as_json=json)


@app.command()
def schema(json: Annotated[bool, typer.Option("--json", help="The same: the schema is JSON.")] = False) -> Work:
    """Print the JSON schema of a scenario file, for editors."""
    return commands.schema


@app.command()
def reproduce(
    paper: Annotated[Optional[str], typer.Argument(metavar="[PAPER]", help="One paper; all of them if left out.")] = None,  # noqa: UP045
    out: Out = None,
    json: Json = False,
) -> Work:
    """Measure the papers' tests again: published beside ours beside the theoretical limit."""
    return partial(commands.reproduce, paper, out=out, as_json=json)
