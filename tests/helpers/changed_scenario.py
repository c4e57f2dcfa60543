"""A scenario with other keys."""

from insenv.scenario import load, parse


def changed(name, **sections):
    """A scenario with keys replaced: of sections, given as ``section={key: value}``, and of its own."""
    values = load(name).model_dump(mode="json", exclude_unset=True)
    for section, keys in sections.items():
        values[section] = {**(values.get(section) or {}), **keys} if isinstance(keys, dict) else keys
    return parse(values, name=name)


def car_of_any_heading():
    """Gyros that lose a heading soon, an attitude that is not known: `fusion` begins with `insenv.estimators.every_heading`."""
    known = {"heading_sigma_deg": 180.0, "tilt_sigma_deg": 180.0}
    return changed("car-unknown-heading", imu={"grade": "autopilot"}, knowledge=known, rate_hz=60.0)
