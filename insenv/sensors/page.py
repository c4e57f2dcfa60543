"""The generated parts of docs/sensors.md: tables of rows and of grades, put between the page's markers.

``python -m insenv.sensors.page docs/sensors.md`` brings a page up to date; a test compares.
"""

from __future__ import annotations

import sys
from collections.abc import Iterable
from pathlib import Path
from typing import Any

from insenv.core.tables import Row, Table
from insenv.sensors.catalogue import GNSS_GRADES, IMU_GRADES
from insenv.sensors.gnss import GNSS_PARAMETERS, GNSS_STATE
from insenv.sensors.grades import ImuGrade
from insenv.sensors.imu_tables import IMU_PARAMETERS, IMU_STATE


def rows_markdown(table: Table) -> str:
    """The rows of a table as a Markdown table."""
    head = ["row", "shape", "unit", "frame", "start", "meaning"]
    return _markdown(head, ([f"`{r.name}`", _shape(r), r.unit, r.frame, _start(r), r.meaning] for r in table))


def imu_markdown() -> str:
    """The IMU catalogue: each grade, its figures and where each comes from."""
    return "\n".join(_grade_markdown(grade) for grade in IMU_GRADES.values()).rstrip()


def gnss_markdown() -> str:
    """The GNSS catalogue as a Markdown table."""
    head = [
        "grade",
        "what",
        "white position N, E, D (m)",
        "white velocity (m/s)",
        "correlated position",
        "source",
    ]
    rows = []
    for grade in GNSS_GRADES.values():
        wander = f"{_figure(grade.wander_sigma_m)} m, {grade.wander_time_s:g} s" if any(grade.wander_sigma_m) else ""
        noise = _figure(grade.position_noise_m), _figure(grade.velocity_noise_m_s)
        rows.append([f"`{grade.name}`", grade.title, *noise, wander, grade.source])
    return _markdown(head, rows)


SECTIONS = {
    "imu-parameters": lambda: rows_markdown(IMU_PARAMETERS),
    "imu-state": lambda: rows_markdown(IMU_STATE),
    "gnss-parameters": lambda: rows_markdown(GNSS_PARAMETERS),
    "gnss-state": lambda: rows_markdown(GNSS_STATE),
    "imu-grades": imu_markdown,
    "gnss-grades": gnss_markdown,
}
"""What stands between ``<!-- begin NAME -->`` and ``<!-- end NAME -->``."""


def updated(text: str) -> str:
    """The page `text` with every generated section as it should be; raises `ValueError` if one is missing."""
    for name, section in SECTIONS.items():
        begin, end = f"<!-- begin {name} -->\n", f"<!-- end {name} -->"
        if text.count(begin) != 1 or text.count(end) != 1:
            raise ValueError(f"the page must have one section {name!r}")
        before, rest = text.split(begin)
        text = before + begin + section() + "\n" + end + rest.split(end)[1]
    return text


def _grade_markdown(grade: ImuGrade) -> str:
    figures = grade.figures().items()
    head = f"### `{grade.name}`: {grade.title}\n"
    if not figures:
        return head
    rows = ([f"`{name}`", _figure(value), grade.source(name)] for name, value in figures)
    return f"{head}\n{_markdown(['figure', 'value', 'source'], rows)}\n"


def _markdown(head: list[str], rows: Iterable[list[str]]) -> str:
    lines = [head, ["---"] * len(head), *rows]
    return "\n".join("| " + " | ".join(line) + " |" for line in lines)


def _shape(row: Row) -> str:
    return " x ".join(map(str, row.shape))


def _start(row: Row) -> str:
    values = [f"{value:g}" for value in row.flat_start()]
    return values[0] if len(set(values)) == 1 else ", ".join(values)


def _figure(value: Any) -> str:
    if not isinstance(value, tuple):
        return f"{value:.5g}"
    return f"{value[0]:.3g}" if len(set(value)) == 1 else ", ".join(f"{v:.3g}" for v in value)


if __name__ == "__main__":
    for argument in sys.argv[1:]:
        page = Path(argument)
        page.write_text(updated(page.read_text(encoding="utf-8")), encoding="utf-8")
