"""Take the installed outside package through every interface of insenv; print what each gave as JSON.

Run by test_outside.py: `python take_through.py WHAT FOLDER`, WHAT a function of this file.
"""

import json
import sys
from pathlib import Path

import fmpy
import numpy as np
from places import ROOT

import insenv
from insenv.core.batch import make_batch
from insenv.core.runner import make_runner
from insenv.fmu.running import run
from insenv.plant.feeding import input_rows
from insenv.scenario import build, load

RAIL = ROOT / "tests" / "outside" / "rail" / "rail.toml"
CAR = {
    "title": "Car with a compass", "duration_s": 60, "rate_hz": 100,
    "start": {"latitude_deg": 50, "longitude_deg": 8, "height_m": 100},
    "vehicle": {"kind": "car", "legs": [
        {"wait_s": 5}, {"accelerate_to_mps": 10}, {"drive_s": 20}, {"turn_deg": 90, "radius_m": 30},
    ]},
    "imu": {"grade": "tactical"}, "gnss": {"grade": "spp", "interval_s": 1}, "compass": {"noise_deg": 0.5, "deviation_deg": 3},
    "knowledge": {"heading_error_deg": 5},
}  # fmt: skip


def fed(scenario, id, duration_s):
    """The adapted estimator, its parameters, the plant's columns and the estimator's input rows."""
    plant = build(load(scenario), duration_s=duration_s)
    columns = plant.model.outputs.unpack(make_runner(plant.model, plant.parameters).run(plant.samples))
    columns["dt"] = np.full(plant.samples, plant.sample_interval)
    estimator = plant.adapted(id)
    return plant, estimator, plant.parameters_of(estimator), columns, input_rows(estimator.model, columns, plant.samples)


def ahrs(folder: Path) -> dict:
    found = {}
    text = (ROOT / "examples" / "n380-car.toml").read_text()
    standing = folder / "standing.toml"  # an alignment in place is refused where the car drives
    text = text.replace("[imu]", "stop_s = 160.0\n\n[imu]", 1).replace("start_s = 150.0", "")
    standing.write_text(text.replace("from_s = 350.0", "from_s = 50.0"))
    found["replay"] = insenv.replay(standing, "ahrs").results[0].statistics()["rms"]["pitch_deg"]
    given = {"duration_s": 20.0, "vary": {"compass.deviation_deg": (-1.0, 1.0)}}
    summary = insenv.campaign(RAIL, "ahrs", 9, workers=1, **given)
    found["campaign"] = summary.figures()["heading_deg"]["rms"]
    found["workers_agree"] = insenv.campaign(RAIL, "ahrs", 9, **given).figures() == summary.figures()
    plant, estimator, parameters, _, rows = fed(RAIL, "ahrs", 2.0)
    native = estimator.model.outputs.unpack(make_runner(estimator.model, parameters).run(plant.samples, rows))["q_nb"]
    fmu = insenv.export_fmu("ahrs", folder / "ahrs.fmu", settings=parameters)
    names = [
        f"{row.name}[{i + 1}]" if row.shape else row.name for row in estimator.model.inputs for i in range(max(row.size, 1))
    ]
    columns = [(t * plant.sample_interval, *u) for t, u in enumerate(rows)]
    signals = np.array(columns, dtype=[(name, float) for name in ("time", *names)])
    shown = [f"q_nb[{i}]" for i in range(1, 5)]
    stepped = fmpy.simulate_fmu(
        str(fmu), stop_time=2.0, output_interval=plant.sample_interval, input=signals, output=shown
    )  # fmt: skip
    q_nb = np.stack([stepped[name] for name in shown], axis=1)
    found["fmpy_agrees"] = bool(np.array_equal(q_nb[1:], native[: len(q_nb) - 1]))
    found["plant_fmu"] = insenv.export_fmu(RAIL, folder / "rail.fmu").stat().st_size
    return found


def aid(folder: Path) -> dict:
    from insenv_rail.compass_aid import COMPASS, ERROR

    found = {}
    smoother = insenv.fusion([ERROR], ["gnss", "zero_velocity", COMPASS], "compass-fusion", smoother=True)
    filtered, smoothed = insenv.run(CAR, ["compass-fusion", smoother]).results
    found["heading_deg"] = [float(r.errors["heading_deg"][-1]) for r in (filtered, smoothed)]
    found["sigma_deg"] = float(filtered.sigma["heading_deg"][-1])
    found["error_deg"] = float(np.degrees(filtered.outputs["compass_error"][-1, 0]))
    found["health"] = filtered.health.as_json()["aids"]["compass"]
    blind = insenv.run(CAR, insenv.fusion(id="blind")).results[0]
    found["blind_sigma_deg"] = float(blind.sigma["heading_deg"][-1])
    told = {"compass-fusion": {"compass_error_sigma_deg": 0.3}}
    found["notes"] = list(insenv.run(CAR, "compass-fusion", settings=told).results[0].notes)
    found["campaign"] = insenv.campaign(CAR, "compass-fusion", 3, duration_s=30.0).figures()["heading_deg"]["rms"]
    plant, estimator, parameters, columns, rows = fed(CAR, "compass-fusion", 10.0)
    native, slow = (make_runner(estimator.model, parameters, b).run(plant.samples, rows) for b in ("native", "interpreter"))
    found["interpreter_agrees"] = bool(np.array_equal(native, slow))
    packed = np.tile(estimator.model.parameters.pack(parameters), (3, 1))
    batch = make_batch(estimator.model, 3, packed, threads=1).run(plant.samples, np.tile(rows, (3, 1, 1)), every=1)
    found["batch_agrees"] = bool(np.array_equal(batch[1], native))
    given = {"sample_interval": plant.sample_interval, "step_is_one_increment": True}
    fmu = insenv.export_fmu("compass-fusion", folder / "compass.fmu", settings={**parameters, **given})
    stepped = run(fmu, {row.name: columns[row.name] for row in estimator.model.inputs if row.name in columns}).named()
    unpacked = estimator.model.outputs.unpack(native)
    found["fmu_agrees"] = all(
        np.array_equal(np.ravel(stepped[name]), np.ravel(unpacked[name])) for name in ("q_nb", "compass_error")
    )
    return found


if __name__ == "__main__":  # worker processes import this file
    print(json.dumps({"ahrs": ahrs, "aid": aid}[sys.argv[1]](Path(sys.argv[2]))))
