"""`kind = "fmu"`: an outside vehicle model as truth, through its FMU (FMI 2 or 3).

The FMU is run once, by FMPy, over the duration; position, velocity and attitude at its outputs become the points of a track.
Its binary code runs with the rights of the user: use FMUs that you trust.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import model_validator

from insenv import attitude
from insenv.base.errors import InputError, nearest
from insenv.base.remarks import declared
from insenv.base.toml import Number, Positive, Section, key, list_of
from insenv.core.tables import Array
from insenv.geodesy import STANDARD_GRAVITY
from insenv.logs.units import ANGLE_UNITS
from insenv.scenario.tracks.section import RecordedFile, knot_interval, spacing
from insenv.scenario.tracks.shape import Points, Shape, check_velocity, checked, motion, shaped
from insenv.vehicles.section import MAX_DURATION_S

_Three = Annotated[tuple[str, str, str], list_of(3, "three names of variables")]
_Four = Annotated[tuple[str, str, str, str], list_of(4, "four names of variables")]


class Outputs(Section):
    """Names of the variables of an FMU; an element of an array is NAME[1]."""

    latitude: str = key(..., "geodetic latitude")
    longitude: str = key(..., "longitude")
    height: str = key(..., "height above the ellipsoid, m")
    velocity: _Three | None = key(None, "velocity over ground: north, east, down, m/s")
    roll: str | None = key(None, "roll; with pitch and heading, or none of them")
    pitch: str | None = key(None, "pitch")
    heading: str | None = key(None, "heading, clockwise from north")
    quaternion: _Four | None = key(None, "quaternion from body to north-east-down, instead")
    quaternion_order: Literal["wxyz", "xyzw"] | None = key(
        None, "whether its scalar w comes first or last; absent: first, and refused where the motion contradicts that"
    )
    position_unit: Literal["deg", "rad"] = key("rad", "unit of latitude and longitude")
    angle_unit: Literal["deg", "rad"] = key("rad", "unit of roll, pitch and heading")

    @model_validator(mode="after")
    def _one_attitude(self) -> Outputs:
        angles = [each for each in (self.roll, self.pitch, self.heading) if each is not None]
        if len(angles) not in (0, 3) or (angles and self.quaternion is not None):
            raise ValueError("allowed are roll, pitch and heading, or quaternion, or none of them")
        if self.quaternion_order is not None and self.quaternion is None:
            raise ValueError(f"quaternion_order = {self.quaternion_order!r} has no effect without quaternion")
        return self


_CONTRADICTED = declared("attitude-contradicts-motion", "{said}: is vehicle.outputs.quaternion_order = {order} right?")


class FmuSection(RecordedFile):
    """A vehicle that an FMU moves."""

    kind: Literal["fmu"] = key(..., "kind of vehicle")
    file: str = key(..., "the FMU, relative to this TOML file; its code runs with your rights", min_length=1)
    outputs: Outputs = key(..., "the FMU's variables by meaning")
    parameters: dict[str, Number | bool | str] = key({}, "start values of the FMU's variables by name")
    run_s: Positive = key(..., "time over which the FMU is run", "s", le=MAX_DURATION_S)
    step_s: Positive = key(0.1, "time between outputs", "s", le=60)
    max_contradiction_mps: Positive = key(
        0.05, "a larger difference between the velocities and the derivative of the positions is an error", "m/s", le=100
    )

    def make_shape(self) -> Shape:
        points = checked(_run(self), 10.0 * self.step_s, 1e4)
        shape = shaped(points, knot_interval(self.knot_s, spacing(points), points), self.smoothing_m, self.bank)
        if points.velocity is not None:
            check_velocity(points, shape, self.max_contradiction_mps)
        return shape if self.outputs.quaternion is None else _in_order(self, points, shape)


def _in_order(section: FmuSection, points: Points, shape: Shape) -> Shape:
    """The shape, with a note if the motion contradicts a stated order.  Raises `InputError` if it contradicts the usual one."""
    stated = section.outputs.quaternion_order
    order = stated or "wxyz"
    assert points.attitude is not None
    q_nb = attitude.numeric.from_euler(*points.attitude.T)
    apart = contradictions(q_nb, order, motion(points, shape, 1), motion(points, shape, 2))
    other = other_order(apart, order)
    if other is None:
        return shape
    said = (
        f"the attitude contradicts the motion by {np.degrees(apart[order]):.0f} deg on average with the scalar of the "
        f"quaternion {ORDERS[order]}, by {np.degrees(apart[other]):.0f} deg with it {ORDERS[other]}"
    )
    if stated is None:
        raise InputError(
            f"{points.label}: {said}: state vehicle.outputs.quaternion_order = {other!r}, or {order!r} if the vehicle moves so"
        )
    return replace(shape, notes=(*shape.notes, _CONTRADICTED.filled(said=said, order=repr(order))))


def _failed(description: Any, step_s: float, said: str) -> str:
    """What to say of an FMU that failed: its step where step_s is no multiple of it, or else what the FMU said itself."""
    experiment = description.defaultExperiment
    step = float((experiment.stepSize if experiment is not None else None) or 0.0)
    if step > 0.0 and abs(step_s / step - max(round(step_s / step), 1)) > 1e-6:
        return f"the FMU failed with vehicle.step_s = {step_s:g} s: allowed is a whole multiple of its own step, {step:g} s"
    return f"the FMU failed: {said}"


def _run(section: FmuSection) -> Points:
    import fmpy

    path, names = Path(section.file), section.outputs
    place, velocity = [names.latitude, names.longitude, names.height], list(names.velocity or ())
    angles = [each for each in (names.roll, names.pitch, names.heading) if each is not None]
    elements = list(names.quaternion or ())
    if names.quaternion_order == "xyzw":
        elements = [*elements[3:], *elements[:3]]
    try:
        description = fmpy.read_model_description(str(path), validate=False)
    except Exception as error:  # of whatever kind: the file is anybody's
        raise InputError(f"{path}: not an FMU: {error}") from None
    known = [variable.name for variable in description.modelVariables]
    said: list[str] = []
    outputs = (*place, *velocity, *angles, *elements)
    for name in (*outputs, *section.parameters):
        if name not in known and name.partition("[")[0] not in known:
            raise InputError(f"{path}: no variable {name!r}{nearest(name, known, 'fmpy info')}")
    whole = list(dict.fromkeys(name if name in known else name.partition("[")[0] for name in outputs))
    try:
        result = fmpy.simulate_fmu(
            str(path),
            stop_time=section.run_s,
            output_interval=section.step_s,
            start_values=dict(section.parameters),
            output=whole,
            validate=False,
            logger=lambda *message: said.append(message[-1].decode("utf-8", "replace").strip()),
        )
    except Exception as error:
        raise InputError(f"{path}: {_failed(description, section.step_s, said[-1] if said else str(error))}") from None

    def column(name: str) -> Any:
        if name in result.dtype.names:
            return np.asarray(result[name], dtype=np.float64)
        inner, _, number = name.partition("[")
        elements = np.asarray(result[inner], dtype=np.float64).reshape(len(result), -1)
        place = number.removesuffix("]")
        if not place.isdecimal() or not 1 <= int(place) <= elements.shape[1]:
            raise InputError(
                f"{path}: no variable {name!r}: {inner} has the elements {inner}[1] to {inner}[{elements.shape[1]}]"
            )
        return elements[:, int(place) - 1]

    degrees, turned = ANGLE_UNITS[names.position_unit], ANGLE_UNITS[names.angle_unit]
    euler = None
    if angles:
        euler = np.column_stack([column(name) for name in angles]) * turned
    elif elements:
        q_nb = np.column_stack([column(name) for name in elements])
        euler = np.column_stack(attitude.numeric.to_euler(q_nb / np.linalg.norm(q_nb, axis=1)[:, None]))
    north, east, up = (column(name) for name in place)
    moving = np.column_stack([column(name) for name in velocity]) if velocity else None
    return Points(str(path), np.asarray(result["time"], dtype=np.float64), north * degrees, east * degrees, up, euler, moving)


# Whether the scalar of an outside model's quaternions comes first or last, by the motion.
#
# Four numbers of length 1 are an attitude in either order, but the motion contradicts a wrong one.  The specific force,
# acceleration less gravity, points out of the roof of a vehicle that stands on the ground, floats, or is carried by wings or
# rotors, in a loop too; and most vehicles move forward.  A slow vehicle with a heading near north shows neither.


ORDERS = {"wxyz": "first", "xyzw": "last"}
"""Place of the scalar, by order."""
MOVING = 2.0
"""Speed (m/s) from which a vehicle's direction counts."""
MIN_ANGLE = np.radians(20.0)
"""Smallest contradiction that counts (rad): a ship's list, an aircraft's drift angle."""


def contradictions(q_nb: Array, order: str, velocity: Array, acceleration: Array) -> dict[str, float]:
    """By order, the mean angle (rad) from the roof to the specific force, plus that from the nose to the velocity in motion.

    q_nb (n, 4): scalar first, from numbers read in `order`; velocity (n, 3) m/s, acceleration (n, 3) m/s^2: north, east, down.
    """
    force = acceleration - [0.0, 0.0, STANDARD_GRAVITY]
    moving = np.linalg.norm(velocity, axis=1) > MOVING
    angles = {}
    other, moved = ("xyzw", [3, 0, 1, 2]) if order == "wxyz" else ("wxyz", [1, 2, 3, 0])
    for each, q in ((order, q_nb), (other, q_nb[:, moved])):
        C_nb = attitude.numeric.to_dcm(q)
        angles[each] = _mean_angle(-C_nb[:, :, 2], force) + _mean_angle(C_nb[moving, :, 0], velocity[moving])
    return angles


def _mean_angle(directions: Array, vectors: Array) -> float:
    if not len(vectors):
        return 0.0
    cosine = np.einsum("ni,ni->n", directions, vectors) / np.maximum(np.linalg.norm(vectors, axis=1), 1e-9)
    return float(np.mean(np.arccos(np.clip(cosine, -1.0, 1.0))))


def other_order(angles: dict[str, float], order: str) -> str | None:
    """The order other than `order` if the motion speaks for it, by the result of `contradictions`."""
    other = next(each for each in ORDERS if each != order)
    return other if angles[order] > 2.0 * angles[other] + MIN_ANGLE else None
