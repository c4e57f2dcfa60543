"""The command line's grammar: the commands of `insenv`, in the order of `insenv --help`."""

from __future__ import annotations

import functools
from typing import Annotated, Any

import typer

from insenv.cli import board, fmu
from insenv.cli.lists import examples, list_all, new, schema
from insenv.cli.measures import bench, describe, prove, reproduce
from insenv.cli.options import HELP, OnceCommand
from insenv.cli.runs import page, replay, run
from insenv.cli.stream import stream
from insenv.cli.studies import allan, budget, campaign, train, tune

app = typer.Typer(
    pretty_exceptions_enable=False,
    context_settings=HELP,
    help="Simulate vehicles with inertial sensors, and align and navigate them.",
    epilog="Exit status: 0 done, 1 the work failed, 2 the call was wrong, 128 + N ended by signal N (130: Ctrl-C).",
)
app.command("list", cls=OnceCommand)(list_all)
studies = (campaign, budget, tune, reproduce, prove, train)
for command in (run, replay, describe, allan, page, examples, new, *studies, stream, bench, schema):
    app.command(cls=OnceCommand)(command)
app.add_typer(fmu.app, name="fmu")
app.add_typer(board.app, name="export")
app.add_typer(board.checking, name="check")


@functools.cache
def parser() -> Any:
    """The parser of the command lines, made once in a process."""
    return typer.main.get_command(app)


@app.callback(invoke_without_command=True)
def root(
    context: typer.Context,
    version: Annotated[bool, typer.Option("--version", help="Print the version and exit.", is_eager=True)] = False,
) -> None:
    if version:
        from insenv.base.shipped import __version__

        print(f"insenv {__version__}")
        raise typer.Exit(0)
    if context.invoked_subcommand is None:
        print(context.get_help())
        raise typer.Exit(2)
