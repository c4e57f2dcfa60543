"""Messages about wrong values: key, value, unit and what is allowed, in insenv's own words."""

from typing import Annotated, Literal

import pytest
from pydantic import Field, Strict

from insenv.base.errors import InputError
from insenv.base.toml import Number, Parameter, Section, Vector3, key, read_toml, validated


class Leg(Section):
    drive_s: Number = key(..., "duration", "s", gt=0, lt=5)


class Car(Section):
    kind: Literal["car"] = key(..., "kind")
    car: Number = key(1.0, "a key with the name of a kind", "m", gt=0)


class Ship(Section):
    kind: Literal["ship"] = key(..., "kind")


class File(Section):
    height_m: Number = key(1.0, "height", "m", gt=0, lt=4)
    duration_s: Number = key(1.0, "duration", "s", ge=0.5, le=86400)
    count: Annotated[int, Strict()] = key(1, "count", ge=0, le=2**53)
    title: str = key("a", "title", min_length=1, max_length=3)
    repeat: bool = key(True, "repeat", strict=True)
    stamp: Literal["begin", "end"] = key("end", "stamp")
    legs: tuple[Leg, ...] = key((), "legs", max_length=2)
    arm_m: Vector3 = key((0.0, 0.0, 0.0), "lever arm", "m")
    keep_where: dict[str, Number | list[Number]] = key({}, "filter")
    estimator: dict[str, dict[str, Parameter]] = key({}, "parameters")
    leg: Leg | None = key(None, "leg")
    vehicle: Annotated[Car | Ship, Field(discriminator="kind")] = key(Car(kind="car"), "vehicle")


NAMES = f"(allowed: {', '.join(File.model_fields)})"


def message(model, wrong):
    with pytest.raises(InputError) as caught:
        validated(model, wrong, "mine.toml")
    return str(caught.value)


@pytest.mark.parametrize(("wrong", "said"), [
    ({"height_m": 0}, "height_m = 0 [m]: must be greater than 0"),
    ({"height_m": "1"}, "height_m = '1' [m]: must be a number"),
    ({"height_m": float("nan")}, "height_m = nan [m]: must be a finite number"),
    ({"count": 1.5}, "count = 1.5: must be a whole number"),
    ({"stamp": "middle"}, "stamp = 'middle': must be 'begin' or 'end'"),
    ({"legs": [{"drive_s": 1}] * 3}, "legs: at most 2 legs, 3 given"),
    ({"legs": [3]}, "legs[0] = 3: must be a table of keys"),
    ({"legs": [{"drive": 3, "drive_s": 1}]}, "legs[0].drive: unknown key; did you mean 'drive_s'? (allowed: drive_s)"),
    ({"arm_m": [1, 2]}, "arm_m = [1, 2] [m]: must be a list of three"),
    ({"keep_where": {"mode": "a"}}, "keep_where.mode = 'a': must be a number or a list"),
    ({"estimator": {"a": {"b": {}}}}, "estimator.a.b: must be a number, true or false, text, or a list of these"),
    ({"leg": {}}, "leg.drive_s is missing: duration [s]"),
    ({"vehicle": {"kind": "shp"}}, "vehicle.kind = 'shp': must be one of 'car', 'ship'; did you mean 'ship'?"),
    ({"vehicle": {"kind": "car", "car": 0}}, "vehicle.car = 0 [m]: must be greater than 0"),
    ({"leg": {"drive_s": 1, "count": 1}}, "leg.count: unknown key; it belongs at the top of the file (allowed: drive_s)"),
    ({"car": 3}, f"car: unknown key; it belongs in [vehicle] {NAMES}"),
    (3, "3: must be a table of keys"),
])  # fmt: skip
def test_a_wrong_value_is_named_with_what_is_allowed(wrong, said):
    assert message(File, wrong) == f"mine.toml: {said}"


def test_each_wrong_key_has_its_line_up_to_twenty():
    wrong = {"height_m": 0, "count": -1, "title": 3, "repeat": 3, "stamp": 3, "arm_m": 3, "legs": 3}
    assert len(message(File, wrong).splitlines()) == 7
    lines = message(File, wrong | {f"unknown_{number}": 0 for number in range(15)}).splitlines()
    assert len(lines) == 21 and lines[-1] == "and 2 more"
    with pytest.raises(InputError, match="height_m = 3: keys are read-only"):
        File().height_m = 3


@pytest.mark.parametrize(("raw", "said"), [
    (b"\xff\xfe", "UTF-16"), (b"a = '\xe4'", r"not a UTF-8 text file \(byte 5"), (b" \n", "the file is empty"),
    (b"a = " + b"[" * 5000, "not valid TOML"), (b"title = " + b"9" * 5000, "not valid TOML"), (b"PK\3\4", "an archive"),
])  # fmt: skip
def test_files_that_are_no_toml(tmp_path, raw, said):
    (tmp_path / "x.toml").write_bytes(raw)
    with pytest.raises(InputError, match=rf"x.toml: .*{said}"):
        read_toml(tmp_path / "x.toml")
    (tmp_path / "x.toml").write_text("\ufeffa = 3\n", encoding="utf-8")
    assert read_toml(tmp_path / "x.toml") == {"a": 3}
