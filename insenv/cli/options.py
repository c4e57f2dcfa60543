"""Options that several commands share, and how a command defers its work until the parser is done."""

from __future__ import annotations

import functools
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import Annotated, Optional

import typer

from insenv.base.errors import InputError

Work = Callable[[], "int | None"]
"""Returns the exit status; None: done."""


def given_path(text: str) -> Path:
    """The path that an option or argument gives.  An empty one, which a script passes whose variable is not set, is refused."""
    if not text:
        raise typer.BadParameter("is empty: allowed is a path")
    return Path(text)


HELP = {"help_option_names": ["-h", "--help"]}

Json = Annotated[bool, typer.Option("--json", help="Print one JSON document on stdout and nothing else.")]
Scenario = Annotated[str, typer.Argument(metavar="SCENARIO", help="A name that `insenv list` shows, or a .toml file.")]
Estimator = Annotated[list[str], typer.Option("--estimator", "-e", metavar="ID", help="Estimator to run.")]
"""One, which `one` takes out of the list: an option that is not a list keeps the last of several without a word."""
# Optional: older versions of typer do not accept unions
Estimators = Annotated[
    Optional[list[str]],  # noqa: UP045
    typer.Option("--estimator", "-e", metavar="ID", help="Estimator to run; may be given more than once."),
]
Seed = Annotated[Optional[int], typer.Option(metavar="N", help="Replaces the scenario's seed.")]  # noqa: UP045
FirstSeed = Annotated[
    Optional[int],  # noqa: UP045
    typer.Option(metavar="FIRST", help="Seed of the first run, which replaces the scenario's; later runs count up from it."),
]
Duration = Annotated[
    Optional[float],  # noqa: UP045
    typer.Option(metavar="S", help="Simulated seconds of a run; replaces the scenario's duration."),
]
Settings = Annotated[
    Optional[list[str]],  # noqa: UP045
    typer.Option(
        "--set",
        metavar="ID.KEY=VALUE",
        help="Set a parameter of an estimator, by a key of the scenario's table estimator.ID; may be given more than once.",
    ),
]
Out = Annotated[
    Optional[Path],  # noqa: UP045
    typer.Option(
        "--out",
        "-o",
        parser=given_path,
        metavar="DIR",
        help="Write the results (.npz, .json), the page (.html) and the figure (.png, .svg) there.",
    ),
]
Strict = Annotated[
    bool,
    typer.Option(
        "--strict", help="Exit with status 1 if a filter is overconfident or diverged, or errors exceed 3 stated sigmas."
    ),
]
NoFigure = Annotated[bool, typer.Option("--no-figure", help="With --out: write no figure and no page.")]


def deferred(command: Callable[..., int | None]) -> Callable[..., Work]:
    """The command with the same parameters that returns its work instead of doing it.

    `insenv.cli.main` does the work after the parser has returned, because the parser handles errors in its own way.
    """

    @functools.wraps(command)
    def parsed(*arguments: object, **options: object) -> Work:
        return partial(command, *arguments, **options)

    return parsed


def one(estimators: Sequence[str] | None) -> str | None:
    """The estimator of a command that runs one; None if none is named.  Raises `InputError` for several different ones."""
    if estimators and len(set(estimators)) > 1:
        raise InputError(
            f"-e {' -e '.join(estimators)}: allowed is one estimator; `insenv run` and `insenv campaign` take several"
        )
    return estimators[0] if estimators else None
