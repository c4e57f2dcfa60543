"""What the section of a vehicle is told whose keys or sticks do not fit its equations of motion."""

import re
from dataclasses import replace
from typing import ClassVar, Literal

import casadi as ca
import pytest

import insenv
from insenv import InputError, Row
from insenv.base.keys import rows_of
from insenv.base.toml import Number, key
from insenv.vehicles import VehicleTraits
from insenv.vehicles.car import CarSection
from insenv.vehicles.section import StickCommand
from insenv.vehicles.truth import truth_part

CAR = CarSection(kind="car").vehicle()


class Base(CarSection):
    """A car of another name."""

    kind: Literal["other"] = key(..., "what kind of vehicle")


def built(section, kind="other"):
    values = {"title": "t", "duration_s": 1, "start": {"latitude_deg": 50, "longitude_deg": 8}, "vehicle": {"kind": kind}}
    from insenv.vehicles import registry

    with registry._PLUGINS.passed([section]):
        return insenv.scenario.build(insenv.load(values))


def test_the_unit_of_a_key_is_converted_or_refused():
    class Fast(Base):
        """A car whose speed is in km/h."""

        speed_kmh: Number = key(72.0, "speed at the start", "km/h", row="start_speed")

    assert rows_of(Fast(kind="other"))["start_speed"] == pytest.approx(20.0)
    with pytest.raises(InputError, match="the key of row 'start_speed', 'speed': unit 'kmh': unknown; did you mean 'km/h'"):
        key(72.0, "speed", "kmh", row="start_speed")
    with pytest.raises(InputError, match=r"unit 'deg' \(rad\) is none of its row 'start_speed' in m/s"):
        key(72.0, "speed", "deg", row=Row("start_speed", "Speed", "m/s", lower=0.0, upper=100.0))

    class Turned(Base):
        """A car whose speed is an angle."""

        speed_deg: Number = key(72.0, "speed at the start", "deg", row="start_speed")

    with pytest.raises(InputError, match=r"vehicle kind 'other': key 'speed_deg': unit 'deg' \(rad\) is none of its row"):
        built(Turned)


def test_a_stick_of_a_command_that_the_vehicle_lacks_is_named():
    class Stuck(Base):
        """A car with a stick of no command."""

        traits: ClassVar[VehicleTraits] = VehicleTraits(sticks=(StickCommand("sped", "speed", "x", ("x",), 1.0, 2.0, "m/s"),))

    with pytest.raises(InputError, match="vehicle kind 'other': stick 'speed': command 'sped': unknown; did you mean 'speed'"):
        built(Stuck)


@pytest.mark.parametrize(("changes", "message"), [
    ({"angles": lambda p, x: CAR.angles(p, x)[:2]}, "angles: 2 results: allowed are roll, pitch, heading"),
    ({"velocity_n": lambda p, x, pairs: ca.SX.zeros(2)}, "velocity_n: the result has the shape (2, 1): allowed is (3, 1)"),
    ({"velocity_n": lambda p, x, pairs: [0.0, 0.0, 0.0]}, "velocity_n: the result has the shape (): allowed is (3, 1)"),
])  # fmt: skip
def test_angles_and_velocity_of_the_wrong_size_are_named(changes, message):
    with pytest.raises(InputError, match=re.escape(message)):
        truth_part(replace(CAR, **changes))
