"""Output: tables and JSON on stdout, progress and warnings on stderr."""

from __future__ import annotations

import logging
import sys
import warnings
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from contextvars import ContextVar
from typing import TYPE_CHECKING, Any

from insenv.base.output import WIDTH, to_json

if TYPE_CHECKING:
    from rich.console import Console, RenderableType
    from rich.progress import Progress

    from insenv.report.document import Block, Document
    from insenv.report.files import FilesWritten


_LEVEL: ContextVar[int] = ContextVar("level", default=0)
"""How much is said on stderr about the work: -1 nothing (--quiet), 0, or 1 every step as a line (--verbose)."""
COMPILER = "insenv.core.compile"
"""Name of the logger that tells of compilations."""


def _console(stderr: bool = False) -> Console:
    """A console as wide as the terminal; of 80 columns if there is none."""
    from rich.console import Console

    class Plain(Console):
        def on_broken_pipe(self) -> None:
            raise BrokenPipeError  # which ends the command with status 141; rich would end it with 1, without a word

    console = Plain(stderr=stderr, markup=False, highlight=False, emoji=False)
    console.width = console.width if console.is_terminal else WIDTH
    return console


def print_json(value: Any) -> None:
    """Print one JSON document on stdout."""
    sys.stdout.write(to_json(value) + "\n")


def print_line(text: str = "", stderr: bool = False) -> None:
    """Print one line without wrapping."""
    print(text, file=sys.stderr if stderr else sys.stdout)


def print_answer(as_json: bool, values: Any, lines: Iterable[str]) -> None:
    """Print the values of a short answer as one JSON document, or its lines."""
    if as_json:
        print_json(values)
        return
    for line in lines:
        print_line(line)


def print_blocks(blocks: Iterable[Block]) -> None:
    """Print tables and lines on stdout."""
    from insenv.report.console import fitted

    console = _console()
    for part in fitted(console, blocks):
        _show(console, part)


def _show(console: Console, part: RenderableType) -> None:
    """Print on stdout; in a file or a pipe without the blanks that fill the lines of a table."""
    if console.is_terminal:
        console.print(part)
        return
    with console.capture() as captured:
        console.print(part)
    for line in captured.get().splitlines():
        print_line(line.rstrip())


def print_result(
    document: Document,
    written: FilesWritten | None,
    as_json: bool,
    unwritten: str,
    lines: Iterable[str] = (),
    further: Sequence[str] = (),
) -> None:
    """Print the result of a command: one JSON document, or tables, then `lines`, then which files are where.

    written: the files of --out; None: without it, and `unwritten` says what it would do.  further: names of folders beside
    these files.  What was omitted goes to stderr.
    """
    paths = [str(path) for path in written.paths] if written else []
    if written and written.note:
        notice(written.note)
    if as_json:
        print_json(document.as_json(paths))
        return
    print_blocks(document.blocks())
    print_line()
    for line in lines:
        print_line(line)
    if written:
        base = written.paths[0].parent
        names = [path.relative_to(base).as_posix() for path in written.paths]
        print_line(f"written to {base}: {', '.join([*names, *further])}")
    elif unwritten:
        print_line(unwritten)


def print_table(columns: Sequence[str], rows: Sequence[Sequence[str]], *, head: bool = True) -> None:
    """Print a table on stdout as wide as the terminal; the last column wraps.  head: whether the columns are named."""
    from insenv.report.document import Listing

    print_blocks([Listing(columns, rows, head=head)])


@contextmanager
def speaking(level: int) -> Iterator[None]:
    """Say more or less on stderr during the block; level: -1, 0 or 1."""
    token, notices = _LEVEL.set(level), _notices()
    for each in notices:
        each.spoken = level
    try:
        yield
    finally:
        _LEVEL.reset(token)
        for each in notices:
            each.spoken = 0


def is_quiet() -> bool:
    """Whether nothing is shown about the work (--quiet)."""
    return _LEVEL.get() < 0


def notice(text: str) -> None:
    """Print a line about the work on stderr, unless --quiet is given."""
    if _LEVEL.get() >= 0:
        print_line(f"insenv: {text}", stderr=True)


class Bar:
    """A progress bar; call it with the amount done and the total.  With --verbose it prints lines, one for each tenth."""

    def __init__(self, progress: Progress, description: str) -> None:
        self._progress = progress
        self._description = description
        self._task = progress.add_task(description, total=None)
        self._tenths = 0

    def __call__(self, done: int, total: int) -> None:
        self._progress.update(self._task, completed=done, total=total)
        tenths = 10 * done // total if total else 0
        if _LEVEL.get() > 0 and tenths > self._tenths:
            self._tenths = tenths
            print_line(f"insenv: {self._description}: {10 * tenths} %", stderr=True)

    def describe(self, text: str) -> None:
        """Change the description."""
        self._description, self._tenths = text, 0
        self.remark("")

    def finished(self, text: str) -> None:
        """Say that a part of the work is done; without a terminal as a line."""
        self.describe(text)
        if self._progress.disable:
            notice(text)

    def remark(self, text: str) -> None:
        """Show a remark behind the description; "" for none."""
        description = f"{self._description}: {text}" if text else self._description
        self._progress.update(self._task, description=description)


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
    disabled = _LEVEL.get() != 0 or not sys.stderr.isatty()
    with Progress(*columns, console=_console(stderr=True), transient=True, disable=disabled) as progress:
        bar = Bar(progress, description)
        with _noticed_by(None if progress.disable else bar):
            yield bar


class CompilingNotice(logging.Handler):
    """Reports on stderr that models are compiled: behind the progress bar's description, or once in a separate line.

    With --verbose the begin and the end of each compilation are lines.
    """

    def __init__(self) -> None:
        super().__init__(logging.INFO)
        self.bar: Bar | None = None
        self.spoken = 0  # as `_LEVEL`, which the threads that compile do not know
        self._notified = False

    def emit(self, record: logging.LogRecord) -> None:
        """Show that a compilation begins or has ended."""
        from insenv.core.compile import COMPILED

        text = record.getMessage()
        if self.bar is not None:
            self.bar.remark("" if text == COMPILED else text)
        elif self.spoken > 0:
            print_line(f"insenv: {text}", stderr=True)
        elif self.spoken == 0 and text != COMPILED and not self._notified:
            self._notified = True
            print_line(f"insenv: {text}", stderr=True)


@contextmanager
def compiling_noticed() -> Iterator[None]:
    """Say on stderr during the block that models are compiled."""
    log, notice = logging.getLogger(COMPILER), CompilingNotice()
    level, propagates = log.level, log.propagate
    log.addHandler(notice)
    log.setLevel(logging.INFO)
    log.propagate = False  # a package of example logs gives the root logger a handler, which would say it again
    try:
        yield
    finally:
        log.removeHandler(notice)
        log.setLevel(level)
        log.propagate = propagates


def _notices() -> list[CompilingNotice]:
    return [handler for handler in logging.getLogger(COMPILER).handlers if isinstance(handler, CompilingNotice)]


@contextmanager
def _noticed_by(bar: Bar | None) -> Iterator[None]:
    """Show the notices of compilations in the line of `bar` during the block; None: in separate lines."""
    notices = _notices()
    for notice in notices:
        notice.bar = bar
    try:
        yield
    finally:
        for notice in notices:
            notice.bar = None


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
