"""Output: tables and JSON on stdout, progress and warnings on stderr."""

from __future__ import annotations

import sys
import warnings
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

from insenv.report.document import to_json
from insenv.report.tables import WIDTH, comparison

if TYPE_CHECKING:
    from rich.console import Console, RenderableType
    from rich.progress import Progress

    from insenv.report import Report


def _console(stderr: bool = False) -> Console:
    from rich.console import Console

    class Plain(Console):
        def on_broken_pipe(self) -> None:
            raise BrokenPipeError  # which ends the command with status 141; rich would end it with 1, without a word

    console = Plain(stderr=stderr, markup=False, highlight=False, emoji=False)
    console.width = max(console.width, WIDTH) if console.is_terminal else WIDTH
    return console


def print_json(value: Any) -> None:
    """Print one JSON document on stdout."""
    sys.stdout.write(to_json(value) + "\n")


def print_line(text: str = "", stderr: bool = False) -> None:
    """Print one line without wrapping."""
    print(text, file=sys.stderr if stderr else sys.stdout)


def print_report(report: Report) -> None:
    """Print the tables of a report on stdout."""
    print_parts(comparison(report))


def print_parts(parts: Iterable[RenderableType]) -> None:
    """Print tables and lines on stdout."""
    console = _console()
    for part in parts:
        console.print(part)


def print_table(columns: Sequence[str], rows: Sequence[Sequence[str]], right: Sequence[int] = ()) -> None:
    """Print a table on stdout, in 80 columns; the last column wraps."""
    from rich import box
    from rich.table import Table

    table = Table(box=box.SIMPLE_HEAD, show_edge=False, pad_edge=False, padding=(0, 2, 0, 0))
    for place, name in enumerate(columns):
        table.add_column(name, no_wrap=place < len(columns) - 1, justify="right" if place in right else "left", overflow="fold")
    for row in rows:
        table.add_row(*row)
    _console().print(table)


class Bar:
    """A progress bar; call it with the amount done and the total."""

    def __init__(self, progress: Progress, description: str) -> None:
        self._progress = progress
        self._task = progress.add_task(description, total=None)

    def __call__(self, done: int, total: int) -> None:
        self._progress.update(self._task, completed=done, total=total)

    def describe(self, text: str) -> None:
        """Change the description."""
        self._progress.update(self._task, description=text)


@contextmanager
def working(description: str) -> Iterator[Bar]:
    """Show a progress bar on stderr during the block, if stderr is a terminal."""
    from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn

    columns = (
        TextColumn("{task.description}", markup=False),
        BarColumn(),
        TimeElapsedColumn(),
        TextColumn("left:"),
        TimeRemainingColumn(),
    )
    with Progress(*columns, console=_console(stderr=True), transient=True, disable=not sys.stderr.isatty()) as progress:
        yield Bar(progress, description)


@contextmanager
def quiet_warnings() -> Iterator[None]:
    """Print each warning once, as one line on stderr without file and line."""
    printed: set[str] = set()

    def show(message: Warning | str, category: type[Warning], *place: Any, **more: Any) -> None:
        if str(message) not in printed:
            printed.add(str(message))
            print_line(f"insenv: warning: {message}", stderr=True)

    with warnings.catch_warnings():
        warnings.showwarning = show
        yield
