"""The command `insenv`: parses, calls, prints.  Exit status 0 done, 1 the work failed, 2 the call was wrong, 130 interrupted.

This package stays empty of imports, so that an interruption or a fault is told in one line however early it comes.
"""

from __future__ import annotations

import os
import sys
from collections.abc import Sequence

DONE, FAILED, WRONG, INTERRUPTED, BROKEN_PIPE = 0, 1, 2, 130, 141


def main(arguments: Sequence[str] | None = None) -> None:
    """Run one command line (the process's own if None) and exit.

    With INSENV_DEBUG=1 in the environment an error shows where it came from.
    """
    arguments = list(sys.argv[1:] if arguments is None else arguments)
    if os.environ.get("INSENV_DEBUG", "0") not in ("", "0"):
        sys.exit(_execute(arguments))
    try:
        status = _execute(arguments)
        sys.stdout.flush()
    except BrokenPipeError:  # whoever read our output, as `head` does, has seen enough
        status = BROKEN_PIPE
    except (KeyboardInterrupt, Exception) as error:
        status = _tell(error, "--json" in arguments)
    _drop_unwritten()
    sys.exit(status)


def _execute(arguments: list[str]) -> int:
    """Parse, then work outside the parser, which has its own ideas about errors.  Give the exit status."""
    for stream in (sys.stdout, sys.stderr):
        if hasattr(stream, "reconfigure"):
            stream.reconfigure(errors="replace")  # a title in Greek on a terminal that has no Greek
    from insenv.cli.app import app

    work = app(arguments, prog_name="insenv", standalone_mode=False)
    if not callable(work):  # --help and --version have done theirs
        return int(work or DONE)
    work()
    return DONE


def _tell(error: BaseException, as_json: bool) -> int:
    """One line on stderr, one JSON document on stdout if asked for; give the exit status."""
    from insenv.errors import InputError, InsenvError

    kind, status, hint = type(error).__name__, FAILED, ""
    if isinstance(error, KeyboardInterrupt) or kind == "Abort":
        kind, status, message = "Interrupted", INTERRUPTED, str(error) or "interrupted, nothing written"
    elif hasattr(error, "format_message"):  # the parser's UsageError, whose module differs between versions of typer
        kind, status, message = "InputError", WRONG, error.format_message()
        context = getattr(error, "ctx", None)
        hint = f" (try '{context.command_path if context else 'insenv'} --help')"
    elif isinstance(error, InsenvError):
        message = str(error)
        kind, status = ("InputError", WRONG) if isinstance(error, InputError) else ("InsenvError", FAILED)
    elif isinstance(error, MemoryError):
        message = "out of memory"
    elif isinstance(error, OSError):
        message = error.strerror or str(error)
        message = f"{error.filename}: {message}" if error.filename else message
    else:
        message = f"internal error: {kind}: {error} (INSENV_DEBUG=1 shows where; please report it)"
    try:
        print(f"insenv: {message}{hint}", file=sys.stderr, flush=True)
        if as_json:
            from insenv.report.document import to_json

            print(to_json({"error": {"type": kind, "message": message}}), flush=True)
    except OSError:
        pass
    return status


def _drop_unwritten() -> None:
    """Send what a closed pipe or a full disk did not take to nowhere, or the interpreter would complain at its exit."""
    for stream in (sys.stdout, sys.stderr):
        try:
            stream.flush()
        except OSError:
            nowhere = os.open(os.devnull, os.O_WRONLY)
            os.dup2(nowhere, stream.fileno())
            os.close(nowhere)
