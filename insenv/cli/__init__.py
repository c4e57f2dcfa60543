"""The command `insenv`.  Exit status: 0 done, 1 the work failed, 2 the call was wrong, 128 + N ended by signal N.

This module imports little of insenv at the top, so that an early interruption or error is reported in one line too.
"""

from __future__ import annotations

import os
import re
import sys
from collections.abc import Sequence
from itertools import pairwise
from typing import Any

from insenv.base import starting
from insenv.cli.signals import (
    BROKEN_PIPE,
    DONE,
    FAILED,
    INTERRUPTED,
    WRONG,
    Interruptions,
    drop_unwritten,
    ignore_from_now_on,
    prepare,
)


def main(arguments: Sequence[str] | None = None) -> None:
    """Run a command line (that of the process if None) and exit.

    With INSENV_DEBUG=1 in the environment an error ends in a traceback.
    """
    arguments = list(sys.argv[1:] if arguments is None else arguments)
    prepare()
    if os.environ.get("INSENV_DEBUG", "0") not in ("", "0"):
        sys.exit(_execute(arguments))
    signals = Interruptions()
    try:
        with signals:
            status = _execute(arguments)
        sys.stdout.flush()
    except BrokenPipeError:  # the reader of the output has closed it, as `head` does
        status = BROKEN_PIPE
    except (KeyboardInterrupt, Exception) as error:
        status = _report(error, arguments, signals.number)
    ignore_from_now_on()
    drop_unwritten()
    sys.exit(status)


def _execute(arguments: list[str]) -> int:
    """Parse, then work outside the parser, which handles errors in its own way.  Return the exit status."""
    from insenv.cli.app import parser

    work = parser()(arguments, prog_name="insenv", standalone_mode=False)
    if work == INTERRUPTED:  # by a signal during parsing, which the parser converts to a status
        raise KeyboardInterrupt
    if not callable(work):  # --help and --version are done
        return int(work or DONE)
    from insenv.cli.output import compiling_noticed, quiet_warnings

    with quiet_warnings(), compiling_noticed():  # of a broken plug-in, or because there is no C compiler
        return int(work() or DONE)


def _report(error: BaseException, arguments: Sequence[str], number: int) -> int:
    """Print one line on stderr and, if requested (--json), one JSON document on stdout; return the exit status.

    arguments: of the command line.  number: the signal behind an interruption.
    """
    from insenv.base.errors import InputError, InsenvError

    kind, status, hint = type(error).__name__, FAILED, ""
    if isinstance(error, KeyboardInterrupt) or kind == "Abort":
        kind, status, message = "Interrupted", 128 + number, str(error) or starting.message(number)
    elif hasattr(error, "format_message"):  # the parser's UsageError, whose module differs between versions of typer
        context = getattr(error, "ctx", None)
        kind, status, message = (
            "InputError",
            WRONG,
            _plain(error.format_message(), arguments, context, getattr(error, "param", None)),
        )
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
        message = f"internal error: {kind}: {error} (INSENV_DEBUG=1 shows the traceback; please report it)"
    try:
        print(f"insenv: {message}{hint}", file=sys.stderr, flush=True)
        if "--json" in arguments:
            from insenv.base.output import to_json

            print(to_json({"error": {"type": kind, "message": message}}), flush=True)
    except OSError:
        pass
    return status


_PARSER_TEXTS = (
    (r"Input should be a valid number.*", "allowed is a number"),
    (r"Input should be a valid integer.*", "allowed is a whole number"),
    (r"Input should be greater than or equal to (\S+?)\.?$", r"allowed is a number from \1"),
    (r"Value error, (.*) is not one of (.*?)\.?$", r"\1: allowed is one of \2"),
)


def _plain(message: str, arguments: Sequence[str], context: Any, parameter: Any) -> str:
    """A message of the parser in the words of all other messages.  context, parameter: of the parser, or None."""
    extra = re.match(r"Got unexpected extra argument\S* \((\S+).*\)$", message)
    if extra and context is not None:
        return _extra_argument(extra[1], arguments, context)
    missing = re.match(r"Missing (?:argument|option|parameter) '([^']+)'", message)
    if missing and context is not None:
        if _is_option(parameter):
            return f"{parameter.opts[0]} {parameter.metavar} is missing: {parameter.help.rstrip('.')}"
        return f"{missing[1]} is missing: allowed is {_usage(context)}"
    for pattern, text in _PARSER_TEXTS:
        message = re.sub(pattern, text, message)
    wrong = re.match(r"Invalid value for '([^']+)'[^:]*: (.*)", message, re.DOTALL)
    value = _value_of(parameter, arguments)
    if wrong and value is not None and value not in wrong[2]:
        return f"{wrong[1]} {value}: {wrong[2]}"
    return message


def _value_of(parameter: Any, arguments: Sequence[str]) -> str | None:
    """The last value that the command line gives an option; None if it gives none, or for an argument."""
    value = None
    for name in parameter.opts if _is_option(parameter) else ():
        for place, text in enumerate(arguments):
            if text == name and place + 1 < len(arguments):
                value = arguments[place + 1]
            elif name.startswith("--") and text.startswith(f"{name}="):
                value = text.partition("=")[2]
            elif len(name) == 2 and text.startswith(name) and not text.startswith("--") and len(text) > 2:
                value = text[2:]
    return value


def _is_option(parameter: Any) -> bool:
    return getattr(parameter, "param_type_name", "") == "option"


def _usage(context: Any) -> str:
    """The command with its arguments, which newer versions of the parser put in braces."""
    return re.sub(r"[{}]", "", " ".join([context.command_path, *context.command.collect_usage_pieces(context)]))


def _extra_argument(value: str, arguments: Sequence[str], context: Any) -> str:
    """The message about an argument that a command does not take, such as the value of an option that has none."""
    command = context.command
    flags = {name: each for each in command.params if getattr(each, "is_flag", False) for name in each.opts}
    for before, argument in pairwise(arguments):
        if argument == value and before in flags:
            return f"{value!r} after {before}, which takes no value: {flags[before].help}"
    return f"unexpected argument {value!r}: allowed is {_usage(context)}"
