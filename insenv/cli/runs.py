"""The commands `insenv run` and `insenv replay`: a simulated or recorded run through estimators, and its report."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal, Optional

import typer

from insenv.base.errors import InputError
from insenv.cli.options import (
    Duration,
    Estimators,
    Json,
    Log,
    Options,
    Output,
    Scenario,
    Seed,
    Settings,
    Strict,
    changed_log,
    changed_scenario,
    command,
    each_once,
    out_option,
)
from insenv.cli.signals import DONE, FAILED

if TYPE_CHECKING:
    from insenv.logs import RecordedLog
    from insenv.logs.formats.contract import Files
    from insenv.report import Report


def _with_out(name: str, writes: str) -> Any:
    return typer.Option(f"--{name}", help=f"With --out: write {writes}.")


@dataclass
class Formats(Options):
    """The formats in which other tools read results and sensors; `insenv replay` has an argument ``log``."""

    as_csv: Annotated[bool, _with_out("csv", "truth, estimate, errors and sigma as CSV")] = False
    as_gpx: Annotated[bool, _with_out("gpx", "truth and estimates as a GPX file")] = False
    as_kml: Annotated[bool, _with_out("kml", "truth and estimates as a KML file")] = False
    as_bag: Annotated[bool, _with_out("bag", "sensors, truth and estimates as a ROS 2 bag")] = False
    as_mcap: Annotated[bool, _with_out("mcap", "the same messages as an MCAP recording")] = False
    as_rerun: Annotated[bool, _with_out("rerun", "them as a recording for the Rerun viewer")] = False
    as_nmea: Annotated[bool, _with_out("nmea", "the fixes of the receiver as NMEA 0183")] = False
    as_log: Annotated[bool, _with_out("log", "the sensors as a log that `insenv replay` reads")] = False

    def names(self, out: Path | None) -> tuple[str, ...]:
        """The formats of the call.  Raises `InputError` if there is no folder for them, or a package is missing."""
        chosen = [field.name.removeprefix("as_") for field in fields(self) if getattr(self, field.name)]
        if not chosen:  # without the import of all formats
            return ()
        from insenv.export import check_formats

        if out is None:
            raise InputError(f"--{chosen[0]} writes files: --out DIR names their folder")
        return check_formats(chosen)


def _exported(report: Report, formats: tuple[str, ...], log: Callable[[], RecordedLog]) -> Files:
    """The files of the formats by name.  log: the log of the same drive, made only if a format needs it."""
    if not formats:
        return {}
    from insenv.export import contents_of, needs_log

    return contents_of(report, log() if needs_log(formats) else None, formats)


Start = Literal["coarse", "reference", "stated"]
"""How a replay starts."""


@command
def run(
    scenario: Scenario,
    output: Output,
    formats: Formats,
    estimators: Estimators = None,
    seed: Seed = None,
    duration: Duration = None,
    settings: Settings = None,
    live: Annotated[
        bool, typer.Option("--live", help="With --out: the page NAME.html can simulate too (insenv page).")
    ] = False,
    strict: Strict = False,
) -> int:
    """Simulate a scenario and run estimators on it; print every error beside its theoretical limit."""
    from insenv.estimators import get_all
    from insenv.runs.simulated import run as simulate

    chosen = get_all(each_once(estimators)) if estimators else None
    names = formats.names(output.out)
    loaded, values = changed_scenario(scenario, settings)
    if live and not (output.folder and output.figure):
        raise InputError("--live is about the page that --out DIR writes: allowed with --out and without --no-figure")
    if "nmea" in names and loaded.gnss is None:
        raise InputError(f"--nmea: scenario {loaded.name!r} has no [gnss]")

    def sensors() -> RecordedLog:
        from insenv.export import record

        return record(loaded, seed=seed, duration_s=duration, progress=progress)

    with output.working(loaded.name) as progress:
        documents = {}
        if live:
            from insenv.web.live import live as made
            from insenv.web.live import live_document

            documents["live"] = live_document(made(loaded, chosen, seed=seed, duration_s=duration, settings=values))
        report = simulate(loaded, chosen, seed=seed, duration_s=duration, settings=values, progress=progress)
        _keep(report, output, _exported(report, names, sensors), documents)
    return _show(report, output, strict)


@command
def replay(
    log: Log,
    output: Output,
    formats: Formats,
    estimators: Estimators = None,
    start: Annotated[
        Start, typer.Option(help="Start from the log alone, from the state of its reference, or from that of its \\[initial].")
    ] = "coarse",
    settings: Settings = None,
    outage: Annotated[
        Optional[list[str]],  # noqa: UP045
        typer.Option(
            "--outage",
            metavar="BEGIN:END",
            help="Withhold the fixes between two times in seconds, and compare the estimate with them: BEGIN:END by the log's "
            "clock, +BEGIN:+END from the start of the run; may be given more than once.",
        ),
    ] = None,
    outages: Annotated[
        Optional[str],  # noqa: UP045
        typer.Option(
            "--outages",
            metavar="every=S,length=S",
            help="Withhold them regularly: every so many seconds, each time for so many.",
        ),
    ] = None,
    strict: Strict = False,
) -> int:
    """Run estimators on a recorded log; print their errors against its reference, and against fixes withheld from them."""
    from insenv.estimators import get_all
    from insenv.logs import load
    from insenv.runs.replayed import replay as follow

    if not estimators:
        if not log.exists():
            load(log)  # says what is there instead
        raise InputError("no estimator: name one with -e ID; `insenv list` shows them")
    chosen, names = get_all(each_once(estimators)), formats.names(output.out)
    with output.working(log.name) as progress:
        windows = [*(outage or ()), *([outages] if outages is not None else ())]
        taken, values = changed_log(log, settings)
        report = follow(taken, chosen, start=start, settings=values, outages=windows, progress=progress)
        report = replace(report, scenario=str(log))
        _keep(report, output, _exported(report, names, lambda: load(log) if isinstance(taken, Path) else taken))
    return _show(report, output, strict)


def _keep(report: Report, output: Output, more: Files, documents: Mapping[str, Any] | None = None) -> None:
    """Write the files, those of other formats (`more`), and `documents` in the page."""
    from insenv.report import write_files

    if output.folder is not None:
        output.written = write_files(report, output.folder, output.figure, more, documents)


def _show(report: Report, output: Output, strict: bool) -> int:
    """Print the report; the exit status: with `strict` that of failed work if an estimate states too little."""
    from insenv.base.remarks import Remark
    from insenv.cli.output import print_line
    from insenv.evaluation.nis import Verdict
    from insenv.report import run_document
    from insenv.runs.replayed import REFUSED

    output.show(run_document(report), "--out DIR writes the page, the figure and every array of the run")

    def judged(verdict: Verdict, by: str) -> list[str]:
        aids = {r.estimator: r.health.judged(verdict) for r in report.results if r.health}
        return [f"{id} {by} {' and '.join(names)}" for id, names in aids.items() if names]

    faults = {
        "diverged": judged("diverged", "from"),
        "overconfident": judged("overconfident", "about"),
        "contradicted": [f"{r.estimator} by {', '.join(r.doubts)}" for r in report.results if r.doubts],
        "errors larger than stated": [r.estimator for r in report.results if r.too_sure()],
    }
    lines = [f"{fault}: {', '.join(ids)}" for fault, ids in faults.items() if ids]
    refused = [note for note in report.notes if isinstance(note, Remark) and note.code == REFUSED]
    if not strict or not lines:
        return FAILED if refused else DONE
    print_line(f"insenv: --strict: {'; '.join(lines)}", stderr=True)
    return FAILED


# The command `insenv page`: a scenario and its estimators as one HTML file that simulates in a browser.


@command
def page(
    scenario: Scenario,
    estimators: Estimators = None,
    output: Annotated[
        Optional[Path],  # noqa: UP045
        out_option("X.html", "File to write; without it the page opens in a browser."),
    ] = None,
    seed: Seed = None,
    duration: Duration = None,
    settings: Settings = None,
    as_json: Json = False,
) -> None:
    """Write a scenario and estimators as one HTML file that simulates in a browser; without -o, open it."""
    from insenv.cli.output import print_answer, working
    from insenv.web.live import page as write

    loaded, values = changed_scenario(scenario, settings)
    path = output or _lasting(loaded.name)
    with working(f"page of {loaded.name}") as progress:
        write(loaded, path, each_once(estimators) or None, seed=seed, duration_s=duration, settings=values, progress=progress)
    opened = output is None and _open(path)
    size = path.stat().st_size
    lines = [f"{path}: {size / 1000:.0f} kB{'; opened in the browser' if opened else ''}"]
    if output is None and not opened:
        lines.append("no browser was found here: open this file in one")
    print_answer(as_json, {"written": str(path), "bytes": size, "opened": opened}, lines)


def _lasting(name: str) -> Path:
    """A file that outlives the command, for the browser."""
    import tempfile

    return Path(tempfile.mkdtemp(prefix="insenv-page-")) / f"{name or 'scenario'}.html"


def _open(path: Path) -> bool:
    import webbrowser

    return webbrowser.open(path.resolve().as_uri())
