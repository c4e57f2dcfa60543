"""The noise of a unit as `allan` finds it: its figures and its grade, and what is printed, drawn and written of them."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from scipy.stats import chi2

from insenv.base.errors import InputError
from insenv.base.output import as_path, atomic, check_output_file, finite
from insenv.base.remarks import Remark, as_json, clock
from insenv.report import panels
from insenv.report.document import Block, Document, Line, Page, Sentences, Table, page_of
from insenv.report.notebook import Shown
from insenv.report.panels import Section
from insenv.sensors.grade_file import SUFFIX, read_grade, toml_text
from insenv.sensors.grades import FIGURES, WAYS, ImuGrade, keys_of
from insenv.sensors.imu_tables import ACCEL, GYRO, Triad
from insenv.studies.noise_terms import FLICKER, MARKOV, QUANTIZATION, TIME, WALK, WHITE, Curve, Figure, Terms
from insenv.studies.rest import Part

GRADE_FILE = "unit.toml"
"""Name of the grade file in a folder of results."""
NAME = "allan"
FIT = 6
"""Group of the fit in the figure."""
_DRAWN: Mapping[str, tuple[str, object]] = {
    QUANTIZATION: ("quantization", ":"),
    WHITE: ("white noise", (0, (6, 2))),
    FLICKER: ("flicker", "-."),
    WALK: ("rate random walk", (0, (1, 1))),
    MARKOV: ("Gauss-Markov", "-."),
}
"""Label and pattern of the line of each term."""
_HEADS = {
    "gyro": ("gyro", "ARW deg/sqrt(h)", "slow noise", "lowest"),
    "accel": ("accel", "VRW ug/sqrt(Hz)", "slow noise", "lowest"),
}
_PLURAL = {"gyro": "gyros", "accel": "accelerometers"}
_MEANINGS = {
    "flicker": "flicker: the floor of the deviation",
    "walk": "walk: a random walk of the bias",
    "bias": "bias, time: a Gauss-Markov bias (1 sigma) and its correlation time",
    "count": "count: quantization",
}

_SLOW = {
    FLICKER: ("flicker", "flicker"),
    WALK: ("walk", "rate_random_walk"),
    MARKOV: ("bias", "instability_sigma"),
    TIME: ("time", "instability_time"),
    QUANTIZATION: ("count", "quantum"),
}
"""Of each term but the white noise the name in the table, and the parameter row after the name of the triad."""


def _scales(triad: Triad) -> dict[str, tuple[str, float]]:
    rows = {WHITE: triad.white, **{term: f"{triad.name}_{row}" for term, (_, row) in _SLOW.items()}}
    keys = {term: keys_of(row)[0] for term, row in rows.items()}
    units = {term: float(FIGURES[key].to_si(1.0)) for term, key in keys.items()}
    return {term: (key, units[term] / (12**0.5 if term == QUANTIZATION else 1.0)) for term, key in keys.items()}


SCALES: Mapping[str, Mapping[str, tuple[str, float]]] = {triad.name: _scales(triad) for triad in (GYRO, ACCEL)}
"""Data-sheet figure of each term, and its unit in SI; the figure of quantization is the size of a count, sqrt(12) Q."""


@dataclass(frozen=True, eq=False)
class SensorNoise:
    """The noise of one axis, or of the three axes of a triad together.

    name: "gyro x" ... "accel z", "gyro", "accel"; curve: its Allan deviation; terms: None for an axis without noise;
    warnings: what spoils the curve; distrust: why the figures are not those of the unit, empty if they are.
    """

    name: str
    curve: Curve
    terms: Terms | None
    warnings: tuple[Remark, ...]
    distrust: str = ""

    @property
    def kind(self) -> str:
        """ "gyro" or "accel"."""
        return self.name.split()[0]

    def key(self, term: str) -> str:
        """Data-sheet key of a term."""
        return SCALES[self.kind][term][0]

    @property
    def white_key(self) -> str:
        """Data-sheet key of the white noise."""
        return self.key(WHITE)

    @property
    def unit(self) -> str:
        """Unit of the deviation in tables, figures and documents."""
        return FIGURES[self.key(FLICKER)].unit

    @property
    def scale(self) -> float:
        """That unit in SI."""
        return SCALES[self.kind][FLICKER][1]

    def figures(self) -> dict[str, Figure]:
        """The fitted figures by data-sheet key."""
        figures = {} if self.terms is None else self.terms.figures
        return {SCALES[self.kind][name][0]: _scaled(each, SCALES[self.kind][name][1]) for name, each in figures.items()}

    def upper(self) -> dict[str, float]:
        """Upper bounds (95 %) of the terms that were not seen, by data-sheet key."""
        bounds = {} if self.terms is None else self.terms.upper
        return {SCALES[self.kind][name][0]: bound / SCALES[self.kind][name][1] for name, bound in bounds.items()}

    def floor(self) -> Figure | None:
        """The bias instability of a data sheet, the lowest Allan deviation [deg/h or ug]; None while it still falls."""
        if self.terms is None or not self.terms.slow:
            return None
        fitted = self.terms.variance(self.curve.tau)
        at = int(np.nanargmin(np.where(np.isfinite(self.terms.freedom), fitted, np.nan)))
        freedom, value = float(self.terms.freedom[at]), float(np.sqrt(fitted[at])) / self.scale
        low, high = (value * (freedom / float(chi2.ppf(level, freedom))) ** 0.5 for level in (0.975, 0.025))
        return Figure(value, low, high)


def _scaled(figure: Figure, unit: float) -> Figure:
    return Figure(figure.value / unit, figure.low / unit, figure.high / unit)


@dataclass(frozen=True, eq=False)
class UnitNoise(Shown):
    """What a log shows of its inertial unit.

    log: its name; part: the samples used; axes: the six axes; triads: gyros and accelerometers, three axes together;
    assumed: the class of unit that everything else is taken from, and the sentence that says so.
    """

    log: str
    part: Part
    axes: tuple[SensorNoise, ...]
    triads: tuple[SensorNoise, SensorNoise]
    assumed: ImuGrade
    assumption: str

    @property
    def warnings(self) -> tuple[Remark, ...]:
        """All warnings: of the samples, and of the axes."""
        grouped: dict[Remark, list[str]] = {}
        for axis in self.axes:
            for warning in axis.warnings:
                grouped.setdefault(warning, []).append(axis.name)
        return (*self.part.warnings, *(warning.of(", ".join(names)) for warning, names in grouped.items()))

    def grade(self) -> ImuGrade:
        """The grade: noise as measured, of the three axes together; all else is that of the assumed class.

        So is the noise of gyros or accelerometers whose figures are not trusted.
        """
        trusted = [triad for triad in self.triads if not triad.distrust]
        measured = {key: each.value for triad in trusted for key, each in triad.figures().items()}
        noise = {key: 0.0 for triad in trusted for key, _ in SCALES[triad.kind].values() if not key.endswith("_time_s")}
        others = {key: 0.0 for triad in trusted for ways in WAYS if triad.white_key in ways for key in ways}
        unlimited = ImuGrade("", "")
        ranges = {name: getattr(unlimited, name) for name in ("gyro_range_deg_s", "accel_range_g")}
        times = {name: getattr(unlimited, name) for name in (f"{triad.kind}_instability_time_s" for triad in trusted)}
        sources = {"": self.assumption}
        sources |= dict.fromkeys(measured, f"insenv allan, {self.part.end_s - self.part.begin_s:.6g} s of {self.log}")
        title = f"Unit of {self.log}"[:120]
        return self.assumed.changed(title=title, sources=sources, **{**others, **noise, **ranges, **times, **measured})

    def as_json(self) -> dict[str, Any]:
        """The documented JSON form (docs/json.md)."""
        return dict(
            finite(
                {
                    "log": self.log,
                    "from_s": self.part.begin_s,
                    "to_s": self.part.end_s,
                    "rate_hz": 1.0 / self.part.interval,
                    "axes": [_document_of(axis) for axis in self.axes],
                    "triads": [_document_of(triad) for triad in self.triads],
                    **as_json(self.warnings, "warnings"),
                    "grade": self.grade().figures(),
                    "grade_file": None,
                }
            )
        )

    figure = Shown.plot

    def document(self) -> Document:
        """What is printed and kept of it."""
        return document(self)

    def write_grade(self, path: str | Path) -> Path:
        """Write the grade file, for ``grade = "FILE.toml"``; return its path.  Raises `InputError`."""
        return write_grade(self, as_path("path", path))


def _document_of(noise: SensorNoise) -> dict[str, Any]:
    white = noise.white_key.removeprefix(f"{noise.kind}_")
    figures, floor = noise.figures(), noise.floor()
    confidence = {key: [each.low, each.high] for key, each in figures.items()}
    confidence |= {key: [0.0, bound] for key, bound in noise.upper().items()}
    seen = figures.get(noise.white_key)
    if noise.white_key in confidence:
        confidence[white] = confidence[noise.white_key]
    if floor is not None:
        confidence["bias_instability"] = [floor.low, floor.high]
    return {
        "name": noise.name,
        white: 0.0 if seen is None else seen.value,
        "bias_instability": None if floor is None else floor.value,
        "unit": noise.unit,
        "trusted": not noise.distrust,
        "figures": {key: each.value for key, each in figures.items()},
        "confidence": confidence,
        "tau_s": noise.curve.tau,
        "deviation": noise.curve.deviation / noise.scale,
    }


def document(unit: UnitNoise, grade_file: str | None = None) -> Document:
    """What is printed and kept of the noise of a unit; its files are allan.json, unit.toml, the page and the figure.

    grade_file: the path of a grade file that was written.
    """
    return Document(
        NAME,
        {**unit.as_json(), "grade_file": grade_file},
        partial(blocks, unit),
        {GRADE_FILE: grade_text(unit)},
        page=partial(page, unit),
        figure=partial(picture, unit),
        order=("json", "texts", "html", "png", "svg"),
        located=True,
    )


# --- tables --------------------------------------------------------------------------------------------


def blocks(unit: UnitNoise) -> Iterator[Block]:
    """The printed lines and tables, top to bottom: gyros and accelerometers, axis by axis and all together."""
    part, rows = unit.part, (*unit.axes, *unit.triads)
    facts = f"{part.end_s - part.begin_s:.6g} s {_of(part)} from {clock(part.begin_s)} s on, {1.0 / part.interval:.6g} Hz"
    columns = 4 if any(noise.floor() for noise in rows) else 3
    yield Line(unit.log, "bold")
    yield Sentences("facts", [facts])
    for kind, head in _HEADS.items():
        shown = [noise for noise in rows if noise.kind == kind]
        names = [noise.name if " " in noise.name else f"{noise.name}, all" for noise in shown]
        cells = [(name, *_cells(noise))[:columns] for name, noise in zip(names, shown, strict=True)]
        yield Line()
        yield Table(head[:columns], cells, gap=1, caption=_PLURAL[kind].capitalize(), wide=True)
    yield Line()
    yield Sentences("explained", list(_explained(rows)), "dim")
    yield Sentences("notes", unit.warnings, "yellow", "warning: ")


def _of(part: Part) -> str:
    """What the part is, after its duration."""
    return "in motion" if part.moves else "without motion"


def _explained(rows: Sequence[SensorNoise]) -> Iterator[str]:
    """What the entries mean that the tables have."""
    if any(noise.terms is not None and not noise.distrust for noise in rows):
        yield "±: half the width of the 95 % bounds"
    if any(noise.terms is not None and noise.distrust for noise in rows):
        yield "not trusted: not the figures of the unit alone; a grade file has those of a coarse class instead"
    shown = {name for noise in rows for name, key, _ in _slow(noise) if key in noise.figures()}
    if shown:
        yield f"{'; '.join(text for name, text in _MEANINGS.items() if name in shown)}; in brackets: 95 % bounds"
    if any(noise.terms is not None and not (noise.terms.slow and WHITE in noise.terms.figures) for noise in rows):
        yield "not seen: not detected; the value is an upper bound (95 %)"
    if any(noise.floor() for noise in rows):
        yield "lowest (deg/h, ug): of the Allan deviation, a data sheet's bias instability; empty while it still falls"


def _cells(noise: SensorNoise) -> tuple[str, str, str]:
    figures, floor = noise.figures(), noise.floor()
    if noise.terms is None:
        return "none", "none", "none"
    shown = _unbounded if noise.distrust else _bounded
    slow = [f"{name} {shown(figures[key], unit)}" for name, key, unit in _slow(noise) if key in figures]
    if not noise.terms.slow and not noise.distrust:
        slow.append(f"not seen: flicker below {_number(noise.upper()[noise.key(FLICKER)])} {noise.unit}")
    return (_white(noise), "\n".join(slow), "" if floor is None or noise.distrust else _number(floor.value))


def _white(noise: SensorNoise) -> str:
    """The white noise of a row of the table."""
    figure = noise.figures().get(noise.white_key)
    text = f"not seen: below {_number(noise.upper()[noise.white_key])}" if figure is None else _number(figure.value)
    if noise.distrust:
        return "not trusted" if figure is None else f"{text}, not trusted"
    return text if figure is None else f"{text} ±{50.0 * (figure.high - figure.low) / figure.value:.1g} %"


def _slow(noise: SensorNoise) -> Iterator[tuple[str, str, str]]:
    """Name in the table, data-sheet key and unit of the terms but the white noise."""
    for term, (name, _) in _SLOW.items():
        yield name, noise.key(term), FIGURES[noise.key(term)].unit


def _bounded(figure: Figure, unit: str) -> str:
    return f"{_number(figure.value)} [{_number(figure.low)}, {_number(figure.high)}] {unit}"


def _unbounded(figure: Figure, unit: str) -> str:
    return f"{_number(figure.value)} {unit}"


def _number(value: float) -> str:
    """Three significant digits, without an exponent up to a million."""
    return f"{float(f'{value:.3g}'):g}"


# --- figure --------------------------------------------------------------------------------------------


LEGEND = ("x", "y", "z", "", "", "", "fit, three axes")
"""By group; that of the fit is `FIT`."""


def page(unit: UnitNoise) -> Page:
    """The page of a unit: its tables, and the Allan deviations with their bounds and the fit at the measured times."""
    sections = [Section("Allan deviation", [_fitted(unit, triad) for triad in unit.triads], columns=2)]
    shown = page_of(
        blocks(unit),
        tab=f"{unit.log}: Allan deviation",
        title="Allan deviation: the noise of the unit",
        legend=[{"name": name} for name in LEGEND],
        explained=["Bands: 95 % bounds of an axis."],
        sections=sections,
        more={"axis": {"name": "Averaging time", "unit": "s", "log": True}},
    )
    tables = [
        replace(table, columns=list(map(_on_page, table.columns)), rows=[list(map(_on_page, row)) for row in table.texts])
        for table in shown.tables
    ]
    return replace(shown, tables=tables, explained=list(map(_on_page, shown.explained)))


def _on_page(cell: str) -> str:
    """A cell or a sentence of the terminal as the page has it: in one line, with the sign of micro."""
    return re.sub(r"\bug\b", "\N{MICRO SIGN}g", cell.replace("\n", "; "))


def _fitted(unit: UnitNoise, triad: SensorNoise) -> panels.TimePanel:
    """The panel of the figure, with the fit at the times of the deviations and without its terms."""
    panel = _panel(triad, [axis for axis in unit.axes if axis.kind == triad.kind])
    measured = [mark for mark in panel.marks if not (isinstance(mark, panels.Curve) and mark.x is not None)]
    panel.marks = [replace(mark, kind="line") if isinstance(mark, panels.Curve) else mark for mark in measured]
    if triad.terms is not None and measured:
        panel.marks.append(panels.Curve(FIT, np.sqrt(triad.terms.variance(triad.curve.tau)) / triad.scale))
    return panel


def picture(unit: UnitNoise) -> panels.Picture:
    """The Allan deviations of gyros and accelerometers with their 95 % bounds, and the fitted terms of the triads."""
    grid = [_panel(triad, [axis for axis in unit.axes if axis.kind == triad.kind]) for triad in unit.triads]
    title = f"Allan deviation: {unit.log}, {unit.part.end_s - unit.part.begin_s:.6g} s {_of(unit.part)}"
    return panels.Picture(title, [grid], LEGEND, (10.0, 5.2), columns=8)


def _panel(triad: SensorNoise, axes: Sequence[SensorNoise]) -> panels.TimePanel:
    name, unit = ("Gyros", "deg/h") if triad.kind == "gyro" else ("Accelerometers", "µg")
    panel = panels.TimePanel(name, unit, triad.curve.tau, log=True, log_x=True, x_name="averaging time [s]", note="no noise")
    lowest = []
    for group, noise in enumerate(axes):
        if noise.terms is None:
            continue
        value, freedom = noise.curve.deviation / noise.scale, noise.terms.freedom
        low, high = (value * np.sqrt(freedom / chi2.ppf(level, freedom)) for level in (0.975, 0.025))
        panel.marks += [panels.Range(group, low, high, label="95 % bounds of an axis"), panels.Curve(group, value, "marked")]
        lowest.append(value.min())
    if triad.terms is None or not lowest:
        return panel
    tau = np.geomspace(triad.curve.tau[0], triad.curve.tau[-1], 200)
    panel.marks.append(panels.Curve(FIT, np.sqrt(triad.terms.variance(tau)) / triad.scale, x=tau))
    for term in triad.terms.figures:
        if term != TIME:
            line = np.sqrt(triad.terms.one(term, tau)) / triad.scale
            seen = line > 0.3 * min(lowest)
            panel.marks.append(panels.Curve(FIT, line[seen], "model", tau[seen], *_DRAWN[term]))
    return panel


# --- files ---------------------------------------------------------------------------------------------


def check_grade(path: Path | None) -> None:
    """Raise `InputError` for a name without .toml, for a file of another kind, or one that cannot be written."""
    if path is None:
        return
    if path.suffix != SUFFIX:
        raise InputError(f"{path}: the name of a grade file ends in {SUFFIX}")
    check_output_file(path)
    if path.exists():
        try:
            read_grade(path)
        except InputError:
            raise InputError(f"{str(path)!r} exists and is not a grade file: it is not overwritten") from None


def write_grade(unit: UnitNoise, path: Path) -> Path:
    """Write the grade file.  Raises `InputError` as `check_grade` does."""
    check_grade(path)
    with atomic(path) as stream:
        stream.write(grade_text(unit).encode())
    return path


def grade_text(unit: UnitNoise) -> str:
    """The text of the grade file: bounds of what is measured stand beside it, of what was not seen at the top."""
    part = unit.part
    lines = [
        f"Written by insenv allan: {part.end_s - part.begin_s:.6g} s {_of(part)} of {unit.log}, three axes together.",
        "An Allan deviation shows noise. All the rest should be replaced by the figures of the data sheet; it is",
        f"{unit.assumption}.",
    ]
    remarks: dict[str, str] = {}
    for triad in unit.triads:
        if triad.distrust:
            lines.append(f"Not trusted, and so the noise of the {_PLURAL[triad.kind]} is assumed too: {triad.distrust}")
            continue
        for key, each in triad.figures().items():
            remarks[key] = f"measured, 95 % within {_number(each.low)} to {_number(each.high)}"
        without_slow = triad.terms is not None and not triad.terms.slow
        for key, bound in triad.upper().items():
            if key == triad.white_key or (without_slow and "quantum" not in key):
                lines.append(f"Not seen: {key} above {bound:.3g} (95 %)")
    lines += [f"Warning: {warning}" for warning in unit.warnings]
    grade = unit.grade()
    remarks |= {key: "assumed" for key in grade.figures() if key not in remarks}
    return toml_text(grade, {**remarks, "": "\n".join(lines)})


def assumed(unit: UnitNoise) -> str:
    """The sentence on what in the grade is not measured."""
    kinds = [_PLURAL[triad.kind] for triad in unit.triads if triad.distrust]
    if not kinds:
        return f"only the noise is measured; all else is {unit.assumption}"
    measured = [_PLURAL[triad.kind] for triad in unit.triads if not triad.distrust]
    if not measured:
        return f"nothing is written as measured, because no noise is trusted; all is {unit.assumption}"
    said = f"only the noise of the {measured[0]} is measured, that of the {kinds[0]} is not trusted"
    return f"{said}; all else is {unit.assumption}"
