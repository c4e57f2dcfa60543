"""Table 2 of the airborne-navigation paper: ten minutes of free-inertial navigation with one constant error, for each of five.

The paper gives the error of one flight at every minute, not what caused it.  Navigation errors are linear in the errors that
cause them, so the response to a unit of each is computed once, by flying with it, and its size is the least-squares fit of the
30 numbers of the table: east, north and up at ten minutes.  The misfit is what the reading cannot explain.

The flight is insenv's: 80 m/s at 6000 m on survey lines of 27 km, the first of which begins with the outage.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from math import radians
from typing import Any

import numpy as np

from insenv import geodesy
from insenv.core.batch import make_batch
from insenv.core.runner import make_runner
from insenv.core.tables import Array
from insenv.estimators import get
from insenv.report.panels import TRUTH_GROUP, Curve, Picture, TimePanel
from insenv.reproduce import Quantity, both, rms
from insenv.scenario import Scenario, build, load
from insenv.scenario.inputs import chunks, input_rows
from insenv.sensors import units

CORRECTED, PRINTED = "wander-sins", "wander-sins-plain"
ENU = np.array([
    (1.27, -1.62, 0.32), (6.25, -5.59, 1.16), (23.29, 4.59, -2.09), (46.06, 8.79, -3.73), (76.39, 9.76, -7.93),
    (117.86, 8.39, -15.88), (179.49, 16.17, -21.37), (256.23, 36.01, -22.62), (343.68, 73.13, -21.95), (441.08, 124.18, -22.34),
])  # fmt: skip
"""Published errors east, north, up after 1, 2, ... 10 min, m."""
DISTANCE = (2.08, 8.46, 23.83, 47.04, 77.42, 119.22, 181.48, 259.73, 352.06, 458.77)
"""Published distance errors, m."""
MINUTES = 10
STATED = {"gyro": 0.1, "accelerometer": 1000.0}
"""Figures of the paper's unit, deg/h and ug."""


@dataclass(frozen=True)
class Reading:
    """One constant error.

    unit: of its size; si: that unit in SI. rows: names of the start rows or of the increments that it changes, with the axis.
    """

    unit: str
    si: float
    rows: tuple[tuple[str, int], ...]


READINGS = {
    "start velocity": Reading("m/s", 1.0, tuple(("start_velocity_n", i) for i in range(3))),
    "level": Reading("deg", radians(1.0), (("start_roll", 0), ("start_pitch", 0))),
    "heading": Reading("deg", radians(1.0), (("start_heading", 0),)),
    "gyro": Reading("deg/h", float(units.deg_h_to_rad_s(1.0)), tuple(("delta_angle", i) for i in range(3))),
    "accelerometer": Reading("ug", float(units.ug_to_m_s2(1.0)), tuple(("delta_velocity", i) for i in range(3))),
}
STEPS = {"start velocity": 0.1, "level": 0.005, "heading": 0.1, "gyro": 0.1, "accelerometer": 100.0}
"""Sizes with which the responses are computed: small, so that they are linear."""


@dataclass(frozen=True)
class Fit:
    """A reading fitted to the table.

    size (n,): of each component, in the unit of the reading. enu (10, 3): errors at each minute, m. misfit: root mean square
    over the minutes of the distance between these and the published ones, m.
    """

    size: Array
    enu: Array
    misfit: float

    @property
    def components(self) -> Array:
        """East, north, up and distance at each minute (10, 4), m."""
        return np.column_stack([self.enu, [np.linalg.norm(row) for row in self.enu]])


def flight() -> Scenario:
    """The survey lines with a perfect unit."""
    loaded = load("aircraft-free-inertial")
    vehicle: Any = loaded.vehicle
    legs = type(vehicle).model_validate({**vehicle.model_dump(), "legs": [{"survey_lines": 3, "line_m": 27000.0}]}).legs
    imu = type(loaded.imu).model_validate({"grade": "perfect"})
    knowledge = loaded.knowledge.model_copy(update={"draw_errors": False})
    return loaded.model_copy(update={"vehicle": vehicle.model_copy(update={"legs": legs}), "imu": imu, "knowledge": knowledge})


@cache
def responses(id: str) -> tuple[Array, Array]:
    """Errors (10, 3) east, north, up without any error, and those per unit of each component (components, 10, 3), m.

    The components are those of `READINGS`, one reading after another.
    """
    components = [(name, *row) for name, reading in READINGS.items() for row in reading.rows]
    plant = build(flight(), seed=1, duration_s=60.0 * MINUTES)
    estimator, count = get(id), len(components) + 1
    table, known = estimator.model.parameters, estimator.parameters(plant.knowledge)
    parameters = np.tile(table.pack(known), (count, 1))
    added = {"delta_angle": np.zeros((count, 3)), "delta_velocity": np.zeros((count, 3))}
    for i, (name, row, axis) in enumerate(components, 1):
        size = STEPS[name] * READINGS[name].si
        if row in added:
            added[row][i, axis] = size * plant.sample_interval
        else:
            parameters[i, table.slice(row).start + axis] += size
    truth, batch = make_runner(plant.model, plant.parameters), make_batch(estimator.model, count, parameters, threads=2)
    every = round(60.0 / plant.sample_interval)
    parts = []
    for _, samples in chunks(plant.samples, every):
        columns = plant.model.outputs.unpack(truth.run(samples))
        fed = {name: columns[name] + added[name][:, None] for name in added}
        fed["dt"] = np.full((count, samples), plant.sample_interval)
        shown = estimator.model.outputs.unpack(
            batch.run(samples, input_rows(estimator.model, fed, count, samples), every=every)
        )
        place = [columns[name][every - 1 :: every] for name in ("latitude", "longitude", "height")]
        ned = geodesy.numeric.ned_offset(shown["latitude"], shown["longitude"], shown["height"], *place)
        parts.append(ned[..., [1, 0, 2]] * [1, 1, -1])
    enu = np.concatenate(parts, axis=1)
    steps = np.array([STEPS[name] for name, _, _ in components])
    return enu[0], (enu[1:] - enu[0]) / steps[:, None, None]


def fit(reading: str, id: str) -> Fit:
    """The sizes of a reading that fit the table best, with the navigation `id`."""
    base, each = _of_reading(reading, id)
    size = np.linalg.lstsq(each.reshape(len(each), -1).T, (ENU - base).ravel(), rcond=None)[0]
    enu = base + np.tensordot(size, each, axes=1)
    return Fit(np.asarray(size, dtype=np.float64), enu, rms(np.linalg.norm(enu - ENU, axis=1)))


def stated(reading: str, id: str) -> Array:
    """Distance (10,) that the stated figure of the unit gives on each axis, 1 sigma over independent axes, m."""
    base, each = _of_reading(reading, id)
    return np.linalg.norm(base, axis=1) + STATED[reading] * np.sqrt(np.sum(each**2, axis=(0, 2)))


def _of_reading(reading: str, id: str) -> tuple[Array, Array]:
    """`responses` to the components of one reading."""
    base, each = responses(id)
    first = sum(len(READINGS[name].rows) for name in list(READINGS)[: list(READINGS).index(reading)])
    return base, each[first : first + len(READINGS[reading].rows)]


def best() -> str:
    """The reading with the smallest misfit."""
    return min(READINGS, key=lambda reading: fit(reading, PRINTED).misfit)


def quantities() -> list[Quantity]:
    """Misfit and size of each reading, and the table for each."""
    rows: list[Quantity] = []
    note = f"one constant error, fitted to the 30 numbers of table 2; {best()} fits best"
    for reading, kind in READINGS.items():
        fits, label = (fit(reading, CORRECTED), fit(reading, PRINTED)), f"table 2 read as {reading}"
        misfits, sizes = both(fits, lambda each: each.misfit), both(fits, lambda each: np.linalg.norm(each.size))
        rows.append(Quantity(f"{label}: misfit over ten minutes", "m", None, *misfits, note=note))
        rows.append(Quantity(f"{label}: fitted size", kind.unit, STATED.get(reading), *sizes, note=note))
        published = {name: ENU[:, i].tolist() for i, name in enumerate(("east", "north", "up"))} | {"distance": DISTANCE}
        for i, (name, numbers) in enumerate(published.items()):
            for minute, number in enumerate(numbers):
                measured = both(fits, lambda each, i=i, k=minute: each.components[k, i])  # type: ignore[misc]
                rows.append(Quantity(f"{label}: {name} after {minute + 1} min", "m", number, *measured, note=note))
    for reading, figure in STATED.items():
        note = "1 sigma over independent axes, nothing estimated before the outage"
        label = f"free inertial, {figure:g} {READINGS[reading].unit} constant on each {reading} axis, distance after 10 min"
        measured = both((CORRECTED, PRINTED), lambda id, reading=reading: stated(reading, id)[-1])  # type: ignore[misc]
        rows.append(Quantity(label, "m", DISTANCE[-1], *measured, note=note))
    measured = both((CORRECTED, PRINTED), lambda id: np.linalg.norm(responses(id)[0][-1]))
    label = "free inertial without any error, distance after 10 min"
    return [*rows, Quantity(label, "m", None, *measured, note="the method alone")]


def picture() -> Picture:
    """Like figures 3 and 4 of the paper: the published errors, and each reading fitted to them."""
    minutes, panels = np.arange(1.0, MINUTES + 1), []
    fits = {reading: fit(reading, PRINTED) for reading in READINGS}
    for i, name in enumerate(("east", "north", "up", "distance")):
        panel = TimePanel(name, "m", minutes, x_name="time without GNSS [min]", x_span=(0.0, 10.3))
        panel.marks += [Curve(group, each.components[:, i]) for group, each in enumerate(fits.values())]
        panel.marks.append(Curve(TRUTH_GROUP, ENU[:, i] if i < 3 else np.array(DISTANCE), "circles"))
        panels.append(panel)
    title = "Table 2: one constant error of each kind, fitted; the paper's navigation as printed"
    names = [f"{reading}: misfit {each.misfit:.0f} m" for reading, each in fits.items()]
    return Picture(title, [panels[:2], panels[2:]], names, (9.0, 6.5), "paper, table 2", columns=3)
