"""The commands `insenv run` and `insenv replay`: a simulated or recorded run through estimators, and its report."""

from __future__ import annotations

import functools
import inspect
from collections.abc import Callable, Mapping, Sequence
from enum import Enum
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Optional

import typer

from insenv.base.errors import InputError
from insenv.cli.interruptions import DONE, FAILED
from insenv.cli.options import (
    Duration,
    Estimators,
    Json,
    NoFigure,
    Out,
    Scenario,
    Seed,
    Settings,
    Strict,
    deferred,
    given_path,
)  # fmt: skip

if TYPE_CHECKING:
    from insenv.logs import RecordedLog
    from insenv.logs.formats.contract import Files
    from insenv.report import OutputFolder, Report


# Options of `insenv run` and `insenv replay` that write results and sensors in the formats of other tools.

OPTIONS = {
    "csv": "write truth, estimate, errors and sigma as CSV.",
    "gpx": "write truth and estimates as a GPX file.",
    "kml": "write truth and estimates as a KML file.",
    "bag": "write sensors, truth and estimates as a ROS 2 bag.",
    "mcap": "write the same messages as an MCAP recording.",
    "rerun": "write them as a recording for the Rerun viewer.",
    "nmea": "write the fixes of the receiver as NMEA 0183.",
    "log": "write the sensors as a log that `insenv replay` reads.",
}
"""Formats by name, each an option --NAME, and what it writes."""


def with_formats(command: Callable[..., int]) -> Callable[..., int]:
    """The command with an option for each format in place of its parameter `formats`, which gets the names asked for."""
    parameters: list[inspect.Parameter] = []
    for parameter in inspect.signature(command, eval_str=True).parameters.values():
        if parameter.name != "formats":
            parameters.append(parameter)
            continue
        for name, writes in OPTIONS.items():
            option = Annotated[bool, typer.Option(f"--{name}", help=f"With --out: {writes}")]
            parameters.append(parameter.replace(name=_PREFIX + name, default=False, annotation=option))

    @functools.wraps(command)
    def chosen(**given: Any) -> int:
        formats = tuple(name for name in OPTIONS if given.pop(_PREFIX + name))
        return command(**given, formats=formats)

    chosen.__signature__ = inspect.Signature(parameters, return_annotation=int)  # type: ignore[attr-defined]
    chosen.__annotations__ = {parameter.name: parameter.annotation for parameter in parameters}
    return chosen


_PREFIX = "as_"
"""Before the name of a format, that of its parameter: `insenv replay` has an argument ``log``."""


def check_asked(out: Path | None, chosen: Sequence[str]) -> tuple[str, ...]:
    """The formats asked for.  Raises `InputError` if there is no folder for them, or a package is missing."""
    if not chosen:  # without the import of all formats
        return ()
    from insenv.export import check_formats

    if out is None:
        raise InputError(f"--{chosen[0]} writes files: --out DIR names their folder")
    return check_formats(chosen)


def exported(report: Report, formats: tuple[str, ...], log: Callable[[], RecordedLog]) -> Files:
    """The files of the formats by name.  log: the log of the same drive, made only if a format needs it."""
    if not formats:
        return {}
    from insenv.export.formats import contents_of, needs_log

    return contents_of(report, log() if needs_log(formats) else None, formats)


class Start(str, Enum):
    """How a replay starts."""

    coarse = "coarse"
    reference = "reference"
    stated = "stated"


@deferred
@with_formats
def run(
    scenario: Scenario,
    estimators: Estimators = None,
    seed: Seed = None,
    duration: Duration = None,
    settings: Settings = None,
    out: Out = None,
    no_figure: NoFigure = False,
    live: Annotated[
        bool, typer.Option("--live", help="With --out: the page NAME.html can simulate too (insenv page).")
    ] = False,
    formats: tuple[str, ...] = (),
    strict: Strict = False,
    as_json: Json = False,
) -> int:
    """Simulate a scenario and run estimators on it; print every error beside its theoretical limit."""
    from insenv.cli.output import working
    from insenv.estimators import get_all
    from insenv.estimators.settings import parsed_settings
    from insenv.report import OutputFolder
    from insenv.runs.simulated import run as simulate
    from insenv.scenario import load

    chosen, given = get_all(estimators) if estimators else None, parsed_settings(settings or [])
    asked = check_asked(out, formats)
    folder = None if out is None else OutputFolder(out)
    loaded = load(scenario)
    if live and (folder is None or no_figure):
        raise InputError("--live is about the page that --out DIR writes: allowed with --out and without --no-figure")
    if "nmea" in asked and loaded.gnss is None:
        raise InputError(f"--nmea: scenario {loaded.name!r} has no [gnss]")

    def sensors() -> RecordedLog:
        from insenv.export import record

        return record(loaded, seed=seed, duration_s=duration, progress=progress)

    with working(loaded.name) as progress:
        documents = {}
        if live:
            from insenv.web.live import live as made
            from insenv.web.live import live_document

            documents["live"] = live_document(made(loaded, chosen, seed=seed, duration_s=duration, settings=given))
        report = simulate(loaded, chosen, seed=seed, duration_s=duration, settings=given, progress=progress)
        more = exported(report, asked, sensors)
        finish = _written(report, folder, not no_figure, as_json, more, documents)
    finish()
    return _status(report, strict)


@deferred
@with_formats
def replay(
    log: Annotated[
        Path, typer.Argument(parser=given_path, metavar="LOG", help="A flight log, or a .toml file that describes a log.")
    ],
    estimators: Estimators = None,
    start: Annotated[
        Start, typer.Option(help="Start from the log alone, from the state of its reference, or from that of its \\[initial].")
    ] = Start.coarse,
    settings: Settings = None,
    out: Out = None,
    no_figure: NoFigure = False,
    formats: tuple[str, ...] = (),
    strict: Strict = False,
    as_json: Json = False,
) -> int:
    """Run estimators on a recorded log; print their errors against its reference."""
    from insenv.cli.output import working
    from insenv.estimators import get_all
    from insenv.estimators.settings import parsed_settings
    from insenv.logs import load
    from insenv.report import OutputFolder
    from insenv.runs.replayed import replay as follow

    if not estimators:
        raise InputError("no estimator: name one with -e ID; `insenv list` shows them")
    chosen, given = get_all(estimators), parsed_settings(settings or [])
    asked = check_asked(out, formats)
    folder = None if out is None else OutputFolder(out)
    with working(log.name) as progress:
        report = follow(log, chosen, start=start.value, settings=given, progress=progress)
        more = exported(report, asked, lambda: load(log))
        finish = _written(report, folder, not no_figure, as_json, more)
    finish()
    return _status(report, strict)


def _status(report: Report, strict: bool) -> int:
    """Exit status after the report is printed; with `strict`, that of failed work if an estimate states too little."""
    from insenv.cli.output import print_line
    from insenv.evaluation.nis import Verdict

    def judged(verdict: Verdict, by: str) -> list[str]:
        found = {r.estimator: r.health.judged(verdict) for r in report.results if r.health}
        return [f"{id} {by} {' and '.join(what)}" for id, what in found.items() if what]

    faults = {
        "diverged": judged("diverged", "from"),
        "overconfident": judged("overconfident", "about"),
        "errors larger than stated": [r.estimator for r in report.results if r.too_sure()],
    }
    told = [f"{fault}: {', '.join(of)}" for fault, of in faults.items() if of]
    if not strict or not told:
        return DONE
    print_line(f"insenv: --strict: {'; '.join(told)}", stderr=True)
    return FAILED


def _written(
    report: Report,
    folder: OutputFolder | None,
    figure: bool,
    as_json: bool,
    more: Files,
    documents: Mapping[str, Any] | None = None,
) -> Callable[[], None]:
    """Write the files, those of other formats (`more`) and `documents` in the page; return what prints the report."""
    from insenv.cli.output import print_result
    from insenv.report import run_document, write_files

    written = None if folder is None else write_files(report, folder, figure, more, documents)
    unwritten = "--out DIR writes the page, the figure and every array of the run"
    return partial(print_result, run_document(report), written, as_json, unwritten)


# The command `insenv page`: a scenario and its estimators as one HTML file that simulates in a browser.


@deferred
def page(
    scenario: Scenario,
    estimators: Estimators = None,
    output: Annotated[
        Optional[Path],  # noqa: UP045
        typer.Option("--output", "-o", parser=given_path, metavar="X.html", help="File to write; without it the page opens."),
    ] = None,
    seed: Seed = None,
    duration: Duration = None,
    settings: Settings = None,
    as_json: Json = False,
) -> None:
    """Write a scenario and estimators as one HTML file that simulates in a browser; without -o, open it."""
    from insenv.cli.output import print_json, print_line, working
    from insenv.estimators.settings import parsed_settings
    from insenv.scenario import load
    from insenv.web.live import page as write

    given, loaded = parsed_settings(settings or []), load(scenario)
    path = output or _kept(loaded.name)
    with working(f"page of {loaded.name}") as progress:
        write(loaded, path, estimators or None, seed=seed, duration_s=duration, settings=given, progress=progress)
    opened = output is None and _open(path)
    size = path.stat().st_size
    if as_json:
        print_json({"written": str(path), "bytes": size, "opened": opened})
        return
    print_line(f"{path}: {size / 1000:.0f} kB{'; opened in the browser' if opened else ''}")
    if output is None and not opened:
        print_line("no browser was found here: open this file in one")


def _kept(name: str) -> Path:
    """A file that outlives the command, for the browser."""
    import tempfile

    return Path(tempfile.mkdtemp(prefix="insenv-page-")) / f"{name or 'scenario'}.html"


def _open(path: Path) -> bool:
    import webbrowser

    return webbrowser.open(path.resolve().as_uri())
