"""What a wrong declaration of an instrument is told, when it is registered or checked, and what it leaves alone."""

import os
import re
import subprocess
import sys
from dataclasses import replace

import casadi as ca
import pytest
from places import ROOT

import insenv
from insenv import InputError, Instrument, Row
from insenv.sensors import registry, units
from insenv.sensors.figures import Figure, Grade, by_name
from insenv.sensors.instrument import Column, Estimated, Setting, constant, drift, white

NOISE = white("radar_noise", "radar noise", "White noise of a speed", "m/s")
SCALE = constant("radar_scale", "scale", "radar scale", "Scale factor", states=(Estimated("radar_scale", "scale factor"),))
DRIFT = drift(
    "radar_drift", "drift", "radar drift", "Slow error", "m/s", (2,), states=(Estimated("radar_drift", "slow error"),)
)
VALUE = Row("radar_speed", "Speed along the forward axis", "m/s", lower=-1e3, upper=1e3)


def measured(motion, e, p):
    return {"radar_speed": (1.0 + e.scale) * motion.body_velocity(ca.SX.zeros(3))[0] + e.drift[0] + e.noise}


RADAR = Instrument(
    "radar",
    title="Radar",
    called="the radar",
    what="speed",
    causes="its scale factor",
    values=(VALUE,),
    terms=(NOISE, SCALE, DRIFT),
    measure=measured,
    holds=("horizontal",),
    aid_parameters=("radar_noise",),
    columns=(Column("speed", "radar_speed", "speed", units.SPEED_UNITS, "km/h"),),
    figures={"noise_mps": Figure("radar_noise", "m/s"), "noise_kmh": Figure("radar_noise", "km/h")},
    grades=by_name(Grade("perfect", "No errors"), Grade.of("car", "Radar of a car", "the author's choice", noise_mps=0.2)),
    grade="car",
)


@pytest.fixture(autouse=True)
def only_here(monkeypatch):
    monkeypatch.setattr(registry._PLUGINS, "_added", dict(registry._PLUGINS._added))


def states(term, *estimated):
    return replace(term, states=estimated)


@pytest.mark.parametrize(("changes", "message"), [
    ({"values": ()}, "values = (): allowed are the rows"),
    ({"terms": (SCALE, DRIFT)}, "no term is white noise: allowed is at least one white(...)"),
    ({"terms": (NOISE, SCALE, replace(DRIFT, name="scale"))}, "two errors are named 'scale'"),
    ({"terms": (NOISE, replace(SCALE, kind="slow"), DRIFT)}, "term 'scale': kind = 'slow': allowed is 'constant', 'drift'"),
    ({"terms": (NOISE, SCALE, replace(DRIFT, time=None))}, "term 'drift': a drift has the rows sigma and time"),
    ({"terms": (NOISE, replace(SCALE, flag="radar_on"), DRIFT)}, "term 'scale': flag 'radar_on': unknown"),
    ({"terms": (NOISE, SCALE, states(DRIFT, *[Estimated(name, "x") for name in "ab"]))}, "2 estimated states"),
    ({"terms": (NOISE, SCALE, states(DRIFT, Estimated("x", "x", (5,))))}, "element 5 of the shape (2,): allowed is 0, 1"),
    ({"terms": (NOISE, SCALE, states(DRIFT, Estimated("x", "x", sigma="y")))}, "state 'x': stated row 'y': unknown"),
    ({"terms": (NOISE, SCALE, states(DRIFT, Estimated("radar_scale", "x")))},
     "the terms 'scale' and 'drift' are both estimated as the state 'radar_scale'"),
    ({"terms": (NOISE, states(SCALE, Estimated("gyro_bias", "x")), DRIFT)},
     "term 'scale': a filter of fusion has the state 'gyro_bias' already"),
    ({"terms": (NOISE, states(SCALE, Estimated("latitude", "x")), DRIFT)}, "a filter of fusion has the state 'latitude'"),
    ({"terms": (NOISE, states(SCALE, Estimated("current", "x")), DRIFT)}, "the sensor 'dvl' has the state 'current'"),
    ({"parameters": (Row("odometer_noise", "x"),)}, "row 'odometer_noise': the sensor 'odometer' has a row of this name"),
    ({"parameters": (Row("gnss_latency", "x"),)}, "row 'gnss_latency': the sensor 'gnss' has a row of this name"),
    ({"parameters": (Row("gyro_bias", "x"),)}, "row 'gyro_bias': the sensor 'imu' has a row of this name"),
    ({"parameters": (VALUE,) * 2}, "two rows are named 'radar_speed'"),
    ({"id": "moored"}, "an aid of fusion has this name: choose another id"),
    ({"holds": ("sideways",)}, "holds: 'sideways': unknown (allowed: vertical, horizontal, heading)"),
    ({"aid_row": "radar_sped"}, "aid_row: 'radar_sped': unknown; did you mean 'radar_speed'?"),
    ({"limit_row": "radar_sped"}, "limit_row: 'radar_sped': unknown"),
    ({"sigma": "radar_sigma"}, "sigma: row 'radar_sigma': unknown"),
    ({"least_sigma": {"radar_sped": 1.0}}, "least_sigma: row 'radar_sped': unknown"),
    ({"aid_parameters": ("radar_arm",)}, "aid_parameters: row 'radar_arm': unknown"),
    ({"figures": {"noise": Figure("radar_noize", "m/s")}}, "figure 'noise': row 'radar_noize': unknown"),
    ({"figures": {"noise_deg": Figure("radar_noise", "deg")}},
     "figure 'noise_deg': unit 'deg' (rad) is none of its row 'radar_noise' in m/s: allowed is 'm/s', 'km/h', 'kn'"),
    ({"figures": {"interval_s": Figure("radar_noise", "m/s")}}, "two keys are named 'interval_s'"),
    ({"grades": by_name(Grade.of("car", "x", nois_mps=1.0))}, "grade 'car': figure 'nois_mps': unknown"),
    ({"grade": "caar"}, "the default grade 'caar': unknown; did you mean 'car'? (allowed: perfect, car)"),
    ({"settings": (Setting("arm_m", float, 0.0, "x", "m", "radar_arm"),)}, "setting 'arm_m': row 'radar_arm': unknown"),
    ({"settings": (Setting("arm_m", float, 0.0, "x", "m", "radar_noise"),)}, "setting 'arm_m': unit 'm' (m) is none of"),
    ({"interval_s": 0.0}, "interval_s = 0.0 s: allowed is above 0 s, at most 3600 s"),
    ({"columns": (Column("speed", "radar_sped", "speed"),)}, "column 'speed': row 'radar_sped': unknown"),
    ({"columns": (Column("speed", "radar_speed", "speed", units.SPEED_UNITS, "mph"),)}, "the default unit 'mph': unknown"),
    ({"columns": (Column("speed", "radar_speed", "speed", axes=True),)}, "axes: row 'radar_speed' has the shape ()"),
    ({"columns": (Column("speed", "radar_speed", "speed"),) * 2}, "two columns are named 'speed'"),
    ({"measure": lambda motion, e, p: {"radar_sped": 0.0}}, "measure: no row named 'radar_sped'; did you mean 'radar_speed'?"),
    ({"measure": lambda motion, e, p: {}}, "measure: row 'radar_speed' is missing"),
    ({"measure": lambda motion, e, p: 0.0}, "measure: the result is of type float"),
    ({"measure": lambda motion, e, p: {"radar_speed": e.drift}}, "row 'radar_speed' has the shape 2 x 1"),
    ({"measure": lambda motion, e, p: {"radar_speed": e.bias}}, "measure: no row named 'bias' (allowed: noise, scale, drift)"),
    ({"measure": lambda motion, e, p: {"radar_speed": p.radar_gain}}, "measure: no row named 'radar_gain'"),
    ({"measure": lambda motion, e, p: {"radar_speed": motion.velocity[0]}}, "measure: the motion has no 'velocity'"),
    ({"measure": lambda motion, e, p: {"radar_speed": ca.exp(e.noise)}},
     "measure: casadi's exp is not exactly rounded: its bits differ between machines: allowed is exp of insenv."),
])  # fmt: skip
def test_a_wrong_declaration_is_refused_by_name(changes, message):
    wrong = replace(RADAR, **changes)
    with pytest.raises(InputError, match=re.escape(message)) as caught:
        insenv.register(wrong)
    assert f"sensor {wrong.id!r}" in str(caught.value) and "\n" not in str(caught.value)
    assert wrong.id not in registry.names()
    with pytest.raises(AssertionError, match=re.escape(message)):
        insenv.testing.check_sensor(wrong)


@pytest.mark.parametrize("id", registry.instruments())
def test_instruments_of_insenv_are_right(id):
    registry.check(registry.instruments()[id])


def test_a_figure_of_an_unknown_unit_is_refused_when_it_is_made():
    with pytest.raises(InputError, match="figure of row 'radar_noise': unit 'knots': unknown; did you mean 'kn'"):
        Figure("radar_noise", "knots")
    assert Figure("radar_noise", "km/h").to_si(36.0) == pytest.approx(10.0) and Figure("x", "rad").to_si(2.0) == 2.0


def test_an_object_is_checked_without_being_registered():
    insenv.testing.check_sensor(RADAR, compiled=False, noise_kmh=1.0)
    assert "radar" not in registry.names()
    insenv.register(RADAR)
    with pytest.raises(AssertionError, match="sensor 'radar': another one is registered by this id"):
        insenv.testing.check_sensor(replace(RADAR, title="Other"), compiled=False)


def test_two_instruments_of_one_row_are_both_named():
    insenv.register(RADAR)
    with pytest.raises(InputError, match=r"sensor 'lidar'.*term 'scale': the sensor 'radar' has the state 'radar_scale'"):
        insenv.register(replace(RADAR, id="lidar"))
    other = replace(RADAR, id="lidar", terms=tuple(replace(term, states=()) for term in RADAR.terms))
    with pytest.raises(InputError, match=r"sensor 'lidar': row 'radar_\w+': the sensor 'radar' has a row of this name"):
        insenv.register(other)


def test_a_wrong_instrument_of_an_installed_package_stops_only_what_asks_for_it(tmp_path):
    info = tmp_path / "mine-1.0.dist-info"
    info.mkdir()
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: mine\nVersion: 1.0\n")
    entries = "".join(f"{id} = own:{id.upper()}\n" for id in ("radar", "lidar"))
    (info / "entry_points.txt").write_text(f"[insenv.sensors]\n{entries}")
    (tmp_path / "own.py").write_text(
        "from dataclasses import replace\nfrom insenv.sensors.figures import Figure\n"
        "from insenv.sensors.odometer import ODOMETER\n"
        "RADAR = replace(ODOMETER, id='radar', figures={'noise_mps': Figure('odometer_noise', 'deg')})\nLIDAR = RADAR\n"
    )
    script = (
        "import insenv.estimators.fusion, insenv, warnings\n"
        "print(insenv.run('car-odometer', 'fusion', duration_s=1.0).results[0].estimator)\n"
        "try: insenv.load({'title': 't', 'duration_s': 1, 'start': {'latitude_deg': 1, 'longitude_deg': 1},"
        " 'vehicle': {'kind': 'car'}, 'radar': {}})\n"
        "except insenv.InsenvError as error: print(error)\n"
    )
    folders = (str(tmp_path), str(ROOT))
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(folders), "INSENV_BACKEND": "interpreter"}
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, env=environment, timeout=100)
    assert done.returncode == 0, done.stderr
    assert done.stdout.startswith("fusion\nsensor 'radar': package 'mine'") and "figure 'noise_mps': unit 'deg'" in done.stdout
    assert done.stderr.count("RuntimeWarning: package 'mine': its entry point") >= 2
