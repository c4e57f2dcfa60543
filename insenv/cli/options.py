"""Options that several commands share, and what every command does: it parses, then works, then shows a `Document`."""

from __future__ import annotations

import functools
import inspect
from collections.abc import Callable, Iterable, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass, fields
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Optional, get_type_hints

import typer
from typer.core import TyperCommand

from insenv.base.errors import InputError

if TYPE_CHECKING:
    from insenv.cli.output import Bar
    from insenv.estimators.settings import Settings as Settings_
    from insenv.logs import RecordedLog
    from insenv.report.document import Document
    from insenv.report.files import FilesWritten, OutputFolder
    from insenv.scenario import Scenario as Scenario_

Work = Callable[[], "int | None"]
"""Returns the exit status; None: done."""


def nonempty_path(text: str) -> Path:
    """The path that an option or argument gives.  An empty one, which a script passes whose variable is not set, is refused."""
    if not text:
        raise typer.BadParameter("is empty: allowed is a path")
    return Path(text)


HELP = {"help_option_names": ["-h", "--help"]}

Json = Annotated[bool, typer.Option("--json", help="Print one JSON document on stdout and nothing else.")]


def _names(incomplete: str) -> list[str]:
    """The scenarios that a shell offers, beside files."""
    from insenv.base.resources import scenario_names

    return [name for name in scenario_names() if name.startswith(incomplete)]


Scenario = Annotated[
    str,
    typer.Argument(metavar="SCENARIO", help="A name that `insenv list` shows, or a .toml file.", autocompletion=_names),
]
Log = Annotated[
    Path, typer.Argument(parser=nonempty_path, metavar="LOG", help="A flight log, or a .toml file that describes a log.")
]


def _ids(incomplete: str) -> list[str]:
    """The estimators that a shell offers."""
    from insenv.estimators import registry

    return [id for id in registry.names() if id.startswith(incomplete)]


Estimator = Annotated[list[str], typer.Option("--estimator", "-e", metavar="ID", help="Estimator to run.", autocompletion=_ids)]
"""One, which `one` takes out of the list: an option that is not a list keeps the last of several without a word."""
# Optional: older versions of typer do not accept unions
Estimators = Annotated[
    Optional[list[str]],  # noqa: UP045
    typer.Option("--estimator", "-e", metavar="ID", help="Estimator to run; may be given more than once.", autocompletion=_ids),
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
        metavar="KEY=VALUE",
        help="Change a key of the scenario or of the log's description (imu.grade=tactical) or a parameter of an estimator"
        " (loosely-coupled.arw_deg_sqrt_h=0.3); may be given more than once.",
    ),
]


def out_option(metavar: str, help: str) -> Any:
    """The option that says where a command writes, under its three names; metavar: what is written, such as X.html."""
    return typer.Option("--out", "--output", "-o", parser=nonempty_path, metavar=metavar, help=help)


Out = Annotated[
    Optional[Path],  # noqa: UP045
    out_option("DIR", "Write the results (.npz, .json), the page (.html) and the figure (.png, .svg) there."),
]
Strict = Annotated[
    bool,
    typer.Option(
        "--strict", help="Exit with status 1 if a filter is overconfident or diverged, or errors exceed 3 stated sigmas."
    ),
]
NoFigure = Annotated[bool, typer.Option("--no-figure", help="With --out: write no figure and no page.")]


class OnceCommand(TyperCommand):
    """A command that refuses an option given twice, of which the parser would keep the last one without a word."""

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        *_, order = self.make_parser(ctx).parse_args(args=list(args))
        for option in order:
            is_once = option.param_type_name == "option" and not (option.multiple or getattr(option, "is_flag", False))
            if is_once and order.count(option) > 1:
                raise InputError(f"{option.opts[0]} is given {order.count(option)} times: allowed is once")
        return super().parse_args(ctx, args)


Quiet = Annotated[
    bool, typer.Option("--quiet", "-q", help="Show no progress and no notices on stderr, only warnings and errors.")
]
Verbose = Annotated[
    bool,
    typer.Option("--verbose", "-v", help="Show progress and each compilation as lines on stderr, also without a terminal."),
]


class Options:
    """A dataclass of options that several commands share, a parameter of these commands."""


@dataclass
class Output(Options):
    """Where the result of a command goes: to stdout as tables or JSON, and to a folder.

    folder: of --out, or None.  Raises `InputError` if it cannot be written to, before the work begins.
    """

    out: Out = None
    no_figure: NoFigure = False
    as_json: Json = False

    def __post_init__(self) -> None:
        self.folder: OutputFolder | None = None
        self.written: FilesWritten | None = None
        if self.out is not None:
            from insenv.report import OutputFolder

            self.folder = OutputFolder(self.out)

    @property
    def figure(self) -> bool:
        """Whether the page and the figure are written."""
        return not self.no_figure

    def working(self, description: str) -> AbstractContextManager[Bar]:
        """Show a progress bar during the block; see `insenv.cli.output.working`."""
        from insenv.cli.output import working

        return working(description)

    def keep(self, document: Document) -> None:
        """Write the files of a document, with --out."""
        if self.folder is not None:
            from insenv.report import write_document

            self.written = write_document(document, self.folder, self.figure)

    def show(self, document: Document, unwritten: str, lines: Iterable[str] = (), further: Sequence[str] = ()) -> None:
        """Print the document; see `insenv.cli.output.print_result`."""
        from insenv.cli.output import print_result

        print_result(document, self.written, self.as_json, unwritten, lines, further)


def command(work: Callable[..., int | None]) -> Callable[..., Work]:
    """The command that returns its work instead of doing it; each parameter that is `Options` becomes these options.

    `insenv.cli.main` does the work after the parser has returned, because the parser handles errors in its own way.
    """
    groups: dict[str, type[Any]] = {}
    parameters: list[inspect.Parameter] = []
    shared: list[inspect.Parameter] = []
    for parameter in inspect.signature(work, eval_str=True).parameters.values():
        group = parameter.annotation
        if not (isinstance(group, type) and issubclass(group, Options)):
            parameters.append(parameter)
            continue
        groups[parameter.name], types = group, get_type_hints(group, include_extras=True)
        for field in fields(group):  # type: ignore[arg-type]
            shared.append(parameter.replace(name=field.name, default=field.default, annotation=types[field.name]))
    parameters += shared
    for name, kind in (("quiet", Quiet), ("verbose", Verbose)):
        parameters.append(inspect.Parameter(name, inspect.Parameter.KEYWORD_ONLY, default=False, annotation=kind))

    def run(**options: Any) -> int | None:
        from insenv.cli.output import speaking

        quiet, verbose = options.pop("quiet"), options.pop("verbose")
        if quiet and verbose:
            raise InputError("--quiet and --verbose: allowed is one of them")
        with speaking(-1 if quiet else int(verbose)):
            return made(**options)

    def made(**options: Any) -> int | None:
        for name, group in groups.items():
            options[name] = group(**{field.name: options.pop(field.name) for field in fields(group)})
        return work(**options)

    @functools.wraps(work)
    def parsed(**options: Any) -> Work:
        return partial(run, **options)

    parsed.__signature__ = inspect.Signature(parameters)  # type: ignore[attr-defined]
    parsed.__annotations__ = {parameter.name: parameter.annotation for parameter in parameters}
    return parsed


def changed_scenario(name: str, texts: Sequence[str] | None) -> tuple[Scenario_, Settings_]:
    """The scenario with the keys that --set changes, and the parameters by estimator id that it sets."""
    from insenv.estimators.settings import parsed_changes
    from insenv.scenario import load, with_changes
    from insenv.scenario.description import scenario_class

    settings, changes = parsed_changes(texts or (), scenario_class().model_fields)
    return with_changes(load(name), changes), settings


def changed_log(path: Path, texts: Sequence[str] | None) -> tuple[RecordedLog | Path, Settings_]:
    """The log at the path, loaded with the keys that --set changes, if any; and the parameters by estimator id that it sets."""
    from insenv.estimators.settings import parsed_changes
    from insenv.logs.loading import keys, load

    settings, changes = parsed_changes(texts or (), keys())
    return load(path, changes) if changes else path, settings


def renamed(old: str, new: str, value: Any) -> Any:
    """The value of an option under its former name, with a note on stderr."""
    from insenv.cli.output import notice

    notice(f"note: {old} is now {new}; the former name still works")
    return value


def one(estimators: Sequence[str] | None) -> str | None:
    """The estimator of a command that runs one; None if none is named.  Raises `InputError` for several."""
    named = each_once(estimators)
    if len(named) > 1:
        raise InputError(f"-e {' -e '.join(named)}: allowed is one estimator; `insenv run` and `insenv campaign` take several")
    return named[0] if named else None


def each_once(estimators: Sequence[str] | None) -> Sequence[str]:
    """The estimators of a command, each once; a note says which are named several times."""
    from insenv.cli.output import notice

    named = list(estimators or ())
    for id in dict.fromkeys(named):
        if named.count(id) > 1:
            notice(f"note: -e {id} is given {named.count(id)} times; it runs once")
    return list(dict.fromkeys(named))
