"""What `insenv allan` prints, draws and writes."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from insenv.base import style
from insenv.base.errors import InputError
from insenv.base.output import atomic, check_output_file, finite, to_json
from insenv.report.files import FilesWritten, OutputFolder, no_matplotlib
from insenv.report.tables import table_of
from insenv.sensors.grade_file import SUFFIX, toml_text
from insenv.studies.noise_terms import FLICKER, MARKOV, QUANTIZATION, TIME, WALK, WHITE, Figure

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure as Picture
    from rich.console import RenderableType

    from insenv.studies.allan import SensorNoise, UnitNoise
    from insenv.studies.rest import Part

GRADE_FILE = "unit.toml"
"""Name of the grade file in a folder of results."""
FIGURE = "allan"
_DRAWN = {
    QUANTIZATION: "quantization",
    WHITE: "white noise",
    FLICKER: "flicker",
    WALK: "rate random walk",
    MARKOV: "Gauss-Markov",
}
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


# --- document ----------------------------------------------------------------------------------------


def document(found: UnitNoise, grade_file: str | None = None, files: Sequence[str] = ()) -> dict[str, Any]:
    """The documented JSON form (docs/json.md); grade_file, files: paths written."""
    one = {
        "log": found.log,
        "from_s": found.part.begin_s,
        "to_s": found.part.end_s,
        "rate_hz": 1.0 / found.part.interval,
        "axes": [_document_of(axis) for axis in found.axes],
        "triads": [_document_of(triad) for triad in found.triads],
        "warnings": list(found.warnings),
        "grade": found.grade().figures(),
        "grade_file": grade_file,
    }
    return finite({**one, **({"files": list(files)} if files else {})})


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


# --- tables --------------------------------------------------------------------------------------------


def tables(found: UnitNoise) -> Iterator[RenderableType]:
    """The printed lines and tables, top to bottom."""
    from rich.text import Text

    part = found.part
    lasts = part.end_s - part.begin_s
    yield Text(found.log, "bold")
    yield Text(f"{lasts:.6g} s {_of(part)} from {part.begin_s:.6g} s on, {1.0 / part.interval:.6g} Hz")
    rows = (*found.axes, *found.triads)
    columns = 4 if any(noise.floor() for noise in rows) else 3
    for kind, head in _HEADS.items():
        yield Text()
        table = table_of(*head[:columns], gap=1)
        for noise in rows:
            if noise.kind == kind:
                name = noise.name if " " in noise.name else f"{noise.name}, all"
                table.add_row(*(name, *_cells(noise))[:columns])
        yield table
    yield Text()
    for told in _explained(rows):
        yield Text(told, "dim")
    for warning in found.warnings:
        yield Text(f"warning: {warning}", "yellow")


def _of(part: Part) -> str:
    """What the part is, after its duration."""
    return "in motion" if part.moves else "without motion"


def _explained(rows: Sequence[SensorNoise]) -> Iterator[str]:
    """What the entries mean that the tables have."""
    if any(noise.terms is not None and not noise.distrust for noise in rows):
        yield "±: half the width of the 95 % bounds"
    if any(noise.terms is not None and noise.distrust for noise in rows):
        yield "not trusted: not the figures of the unit alone; a grade file has those of a coarse class instead"
    shown = {name for noise in rows for name, key, _ in _slow_keys(noise.kind) if key in noise.figures()}
    if shown:
        yield f"{'; '.join(text for name, text in _MEANINGS.items() if name in shown)}; in brackets: 95 % bounds"
    if any(noise.terms is not None and not (noise.terms.slow and WHITE in noise.terms.figures) for noise in rows):
        yield "not seen: noise above this bound (95 %) would have been"
    if any(noise.floor() for noise in rows):
        yield "lowest (deg/h, ug): of the Allan deviation, a data sheet's bias instability; empty while it still falls"


def _cells(noise: SensorNoise) -> tuple[str, str, str]:
    figures, floor = noise.figures(), noise.floor()
    if noise.terms is None:
        return "none", "none", "none"
    shown = _unbounded if noise.distrust else _bounded
    slow = [f"{name} {shown(figures[key], unit)}" for name, key, unit in _slow_keys(noise.kind) if key in figures]
    if not noise.terms.slow and not noise.distrust:
        flicker = noise.upper()[f"{noise.kind}_flicker_{'deg_h' if noise.kind == 'gyro' else 'ug'}"]
        slow.append(f"not seen: flicker below {_number(flicker)} {noise.unit}")
    return (_white(noise), "\n".join(slow), "" if floor is None or noise.distrust else _number(floor.value))


def _white(noise: SensorNoise) -> str:
    """The white noise of a row of the table."""
    figure = noise.figures().get(noise.white_key)
    told = f"not seen: below {_number(noise.upper()[noise.white_key])}" if figure is None else _number(figure.value)
    if noise.distrust:
        return "not trusted" if figure is None else f"{told}, not trusted"
    return told if figure is None else f"{told} ±{50.0 * (figure.high - figure.low) / figure.value:.1g} %"


def _slow_keys(kind: str) -> tuple[tuple[str, str, str], ...]:
    """Name in the table, data-sheet key and unit of the terms but the white noise."""
    unit, key = ("deg/h", "deg_h") if kind == "gyro" else ("ug", "ug")
    count = ("count", "gyro_quantum_arcsec", "arcsec") if kind == "gyro" else ("count", "accel_quantum_m_s", "m/s")
    return (
        ("flicker", f"{kind}_flicker_{key}", unit),
        ("walk", f"{kind}_rrw_{key}_sqrt_h", f"{unit}/sqrt(h)"),
        ("bias", f"{kind}_instability_{key}", unit),
        ("time", f"{kind}_instability_time_s", "s"),
        count,
    )


def _bounded(figure: Figure, unit: str) -> str:
    return f"{_number(figure.value)} [{_number(figure.low)}, {_number(figure.high)}] {unit}"


def _unbounded(figure: Figure, unit: str) -> str:
    return f"{_number(figure.value)} {unit}"


def _number(value: float) -> str:
    """Three significant digits, without an exponent up to a million."""
    return f"{float(f'{value:.3g}'):g}"


# --- figure --------------------------------------------------------------------------------------------


def draw(found: UnitNoise) -> Picture:
    """The Allan deviations of gyros and accelerometers with their 95 % bounds, and the fitted terms of the triads."""
    with style.page(10.0, 5.2) as figure:
        panels = figure.subplots(1, 2)
        for axes, triad in zip(panels, found.triads, strict=True):
            _panel(axes, triad, [axis for axis in found.axes if axis.kind == triad.kind])
        style.title(figure, f"Allan deviation: {found.log}, {found.part.end_s - found.part.begin_s:.6g} s {_of(found.part)}")
        style.legend(figure, panels, columns=8)
        return figure


def _panel(axes: Axes, triad: SensorNoise, live: Sequence[SensorNoise]) -> None:
    from scipy.stats import chi2

    name, unit = ("Gyros", "deg/h") if triad.kind == "gyro" else ("Accelerometers", "µg")
    axes.set_title(f"{name} [{unit}]", loc="left")
    axes.set_xlabel("averaging time [s]")
    axes.set_xscale("log")
    lowest = []
    for noise, colour in zip(live, style.COLOURS, strict=False):
        if noise.terms is None:
            continue
        tau, value, freedom = noise.curve.tau, noise.curve.deviation / noise.scale, noise.terms.freedom
        known = np.isfinite(freedom)
        low, high = (np.sqrt(freedom[known] / chi2.ppf(level, freedom[known])) for level in (0.975, 0.025))
        axes.fill_between(tau[known], value[known] * low, value[known] * high, color=colour, alpha=0.16, linewidth=0)
        axes.fill_between([], [], color=style.LIMIT, alpha=0.16, linewidth=0, label="95 % bounds of an axis")
        axes.plot(tau, value, "o-", markersize=3.0, color=colour, label=noise.name.split()[1])
        lowest.append(value.min())
    style.log(axes)
    if triad.terms is None or not lowest:
        axes.text(0.5, 0.5, "no noise", transform=axes.transAxes, ha="center")
        return
    tau = np.geomspace(triad.curve.tau[0], triad.curve.tau[-1], 200)
    axes.plot(tau, np.sqrt(triad.terms.variance(tau)) / triad.scale, color="#000000", label="fit, three axes")
    dashes = {QUANTIZATION: ":", WHITE: (0, (6, 2)), FLICKER: "-.", WALK: (0, (1, 1)), MARKOV: "-."}
    for term in triad.terms.figures:
        if term == TIME:
            continue
        line = np.sqrt(triad.terms.one(term, tau)) / triad.scale
        seen = line > 0.3 * min(lowest)
        axes.plot(tau[seen], line[seen], linestyle=dashes[term], color=style.LIMIT, linewidth=0.9, label=_DRAWN[term])


# --- files ---------------------------------------------------------------------------------------------


def check_grade(path: Path | None) -> None:
    """Raise `InputError` for a grade file whose name does not end in .toml, or that cannot be written."""
    if path is None:
        return
    if path.suffix != SUFFIX:
        raise InputError(f"{path}: the name of a grade file ends in {SUFFIX}")
    check_output_file(path)


def write_grade(found: UnitNoise, path: Path) -> Path:
    """Write the grade file.  Raises `InputError` as `check_grade` does."""
    check_grade(path)
    with atomic(path) as stream:
        stream.write(grade_text(found).encode())
    return path


def grade_text(found: UnitNoise) -> str:
    """The text of the grade file: bounds of what is measured stand beside it, of what was not seen at the top."""
    part = found.part
    lines = [
        f"Written by insenv allan: {part.end_s - part.begin_s:.6g} s {_of(part)} of {found.log}, three axes together.",
        "An Allan deviation shows noise. All the rest should be replaced by the figures of the data sheet; it is",
        f"{found.assumption}.",
    ]
    remarks: dict[str, str] = {}
    for triad in found.triads:
        if triad.distrust:
            lines.append(f"Not trusted, and so the noise of the {_PLURAL[triad.kind]} is assumed too: {triad.distrust}")
            continue
        for key, each in triad.figures().items():
            remarks[key] = f"measured, 95 % within {_number(each.low)} to {_number(each.high)}"
        without_slow = triad.terms is not None and not triad.terms.slow
        for key, bound in triad.upper().items():
            if key == triad.white_key or (without_slow and "quantum" not in key):
                lines.append(f"Not seen: {key} above {bound:.3g} (95 %)")
    lines += [f"Warning: {warning}" for warning in found.warnings]
    grade = found.grade()
    remarks |= {key: "assumed" for key in grade.figures() if key not in remarks}
    return toml_text(grade, {**remarks, "": "\n".join(lines)})


def assumed(found: UnitNoise) -> str:
    """The sentence on what in the grade is not measured."""
    kinds = [_PLURAL[triad.kind] for triad in found.triads if triad.distrust]
    if not kinds:
        return f"only the noise is measured; all else is {found.assumption}"
    measured = [_PLURAL[triad.kind] for triad in found.triads if not triad.distrust]
    if not measured:
        return f"nothing is written as measured, because no noise is trusted; all is {found.assumption}"
    said = f"only the noise of the {measured[0]} is measured, that of the {kinds[0]} is not trusted"
    return f"{said}; all else is {found.assumption}"


def write_files(found: UnitNoise, folder: OutputFolder, grade_file: Path | None, figure: bool = True) -> FilesWritten:
    """Write allan.json, unit.toml and, if `figure` and matplotlib is installed, allan.png and allan.svg, or none of them."""
    note = no_matplotlib() if figure else ""
    drawn = figure and not note
    names = [f"{FIGURE}.json", GRADE_FILE, *((f"{FIGURE}.png", f"{FIGURE}.svg") if drawn else ())]
    paths = tuple(folder.path / name for name in names)
    with folder.staged() as part:
        text = to_json(document(found, str(grade_file or paths[1]), [str(path) for path in paths])) + "\n"
        part(names[0]).write_text(text, encoding="ascii")
        part(names[1]).write_text(grade_text(found), encoding="utf-8")
        if drawn:
            style.save(draw(found), {kind: part(f"{FIGURE}.{kind}") for kind in ("png", "svg")})
    return FilesWritten(paths, note)
