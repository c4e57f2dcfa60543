"""What the commands do: call the layers below, print, write files.  Heavy imports stay inside the functions."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from insenv.bench import Figure
    from insenv.report import OutputFolder, Report


def run(
    scenario: str,
    estimator_ids: Sequence[str],
    *,
    seed: int | None,
    duration_s: float | None,
    out: Path | None,
    figure: bool,
    as_json: bool,
) -> None:
    """Simulate and estimate; print and write the report."""
    from insenv.cli.output import quiet_warnings, working
    from insenv.report import OutputFolder
    from insenv.runs.simulated import run as simulate
    from insenv.scenario import load

    chosen = _known(estimator_ids)
    folder = None if out is None else OutputFolder(out)
    loaded = load(scenario)
    with quiet_warnings(), working(loaded.name) as progress:
        report = simulate(loaded, chosen or None, seed=seed, duration_s=duration_s, progress=progress)
        finish = _written(report, folder, figure, as_json)
    finish()


def replay(log: Path, estimator_ids: Sequence[str], *, start: str, out: Path | None, figure: bool, as_json: bool) -> None:
    """Run a log through estimators; print and write the report."""
    from insenv.cli.output import quiet_warnings, working
    from insenv.report import OutputFolder
    from insenv.runs.replayed import replay as follow

    chosen = _known(estimator_ids)
    folder = None if out is None else OutputFolder(out)
    with quiet_warnings(), working(log.name) as progress:
        report = follow(log, chosen, start=start, progress=progress)
        finish = _written(report, folder, figure, as_json)
    finish()


def bench(only: str | None, *, as_json: bool) -> None:
    """Measure; print each figure beside its floor."""
    from insenv.bench import figures, machine
    from insenv.cli.output import print_json, print_line, print_table, quiet_warnings, working
    from insenv.report.tables import number

    measured = []
    with quiet_warnings(), working("measuring") as progress:
        for figure in figures(only):
            measured.append(figure)
            progress.describe(f"measuring: {figure.name} done")
    if as_json:
        print_json({"machine": machine(), "figures": [_figure_row(f) for f in measured]})
        return
    print_table(
        ("figure", "value", "floor", "unit", "n", "what"),
        [(f.name, number(f.value), number(f.floor), f.unit, str(f.n), _what(f)) for f in measured],
        right=(1, 2, 4),
    )
    print_line()
    print_line("floor: the same measurement of no work at all")
    print_line("machine: " + ", ".join(str(value) for value in machine().values()))


def _figure_row(figure: Figure) -> dict[str, Any]:
    row = {name: getattr(figure, name) for name in ("name", "value", "unit", "floor", "n", "note")}
    return row if figure.peer is None else {**row, "peer": dict(zip(("name", "value"), figure.peer, strict=True))}


def _what(figure: Figure) -> str:
    from insenv.report.tables import number

    peer = "" if figure.peer is None else f"; {figure.peer[0]}: {number(figure.peer[1])} {figure.unit}"
    return figure.note + peer


def reproduce(paper: str | None, *, out: Path | None, as_json: bool) -> None:
    """Measure the papers' tests again; print published, ours and limit; write the figures."""
    from insenv.cli.output import print_json, print_line, print_table, quiet_warnings, working
    from insenv.report import OutputFolder
    from insenv.report.tables import number
    from insenv.reproduce import PAPERS, chosen, figure
    from insenv.reproduce import reproduce as measure

    papers = chosen(paper)
    folder = None if out is None else OutputFolder(out)
    found, written = {}, []
    with quiet_warnings(), working(f"measuring {papers[0]}") as progress:
        for name, quantities in measure(paper):
            found[name] = quantities
            progress.describe(f"measured {name}")
        if folder is not None:
            folder.path.mkdir(parents=True, exist_ok=True)
            for name in papers:
                written += figure(name, folder.path)
    if as_json:
        print_json([quantity.as_json() for quantities in found.values() for quantity in quantities])
        return
    for name, quantities in found.items():
        print_line(f"{name}: {PAPERS[name]}")
        print_table(
            ("published", "ours", "limit", "ours/limit", "seeds", "unit", "quantity"),
            [
                (number(q.published), number(q.ours), number(q.limit), number(q.ratio), str(q.seeds), q.unit, q.quantity)
                for q in quantities
            ],
            right=(0, 1, 2, 3, 4),
        )
        for note in dict.fromkeys(q.note for q in quantities if q.note):
            print_line(f"note: {note}")
        print_line()
    if written:
        print_line(f"written: {', '.join(str(path) for path in written)}")


def list_all(*, as_json: bool) -> None:
    """What there is, by kind."""
    from insenv import estimators
    from insenv.cli.output import print_json, print_line, print_table
    from insenv.registration import titles
    from insenv.scenario import summaries
    from insenv.sensors import GNSS_GRADES, IMU_GRADES

    scenarios = summaries()
    known: list[dict[str, Any]] = [
        {"id": e.id, "title": e.model.title, "kind": e.kind, "aided": e.aided} for e in estimators.registered().values()
    ]
    grades: dict[str, list[dict[str, str]]] = {
        "imu_grades": [{"name": name, "title": grade.title} for name, grade in IMU_GRADES.items()],
        "gnss_grades": [{"name": name, "title": grade.title} for name, grade in GNSS_GRADES.items()],
    }
    if as_json:
        environments = [{"id": id, "title": title} for id, title in titles().items()]
        print_json({"scenarios": scenarios, "estimators": known, **grades, "environments": environments})
        return
    print_table(("scenario", "duration", "title"), [(s["name"], f"{s['duration_s']:g} s", s["title"]) for s in scenarios])
    print_line()
    takes = {True: "IMU, GNSS", False: "IMU"}
    print_table(("estimator", "kind", "takes", "title"), [(e["id"], e["kind"], takes[e["aided"]], e["title"]) for e in known])
    for key, name in (("imu_grades", "IMU grade"), ("gnss_grades", "GNSS grade")):
        print_line()
        print_table((name, "title"), [(g["name"], g["title"]) for g in grades[key]])
    print_line()
    print_table(("environment", "title"), list(titles().items()))


def schema() -> None:
    """The schema of a scenario file."""
    from insenv.cli.output import print_json
    from insenv.scenario import json_schema

    print_json(json_schema())


def _known(estimator_ids: Sequence[str]) -> list[str]:
    """The ids without repetition.  Raises `InputError` for an unknown one."""
    from insenv import estimators

    return list(dict.fromkeys(estimators.get(id).id for id in estimator_ids))


def _written(report: Report, folder: OutputFolder | None, figure: bool, as_json: bool) -> Callable[[], None]:
    """Write the files, and give what prints the report."""
    from insenv.cli.output import print_json, print_line, print_report
    from insenv.report import document, write_files

    written = None if folder is None else write_files(report, folder, figure)
    paths = [str(path) for path in written.paths] if written else []

    def finish() -> None:
        if written and written.note:
            print_line(f"insenv: {written.note}", stderr=True)
        if as_json:
            print_json(document(report, paths))
            return
        print_report(report)
        print_line()
        if written:
            print_line(f"written to {written.paths[0].parent}: {', '.join(path.name for path in written.paths)}")
        else:
            print_line("--out DIR writes the figure and every array of the run")

    return finish
