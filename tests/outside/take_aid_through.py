"""Take an aid of another package through every interface; print what each gave as JSON.  Run by test_outside.py."""

import json
import sys
from pathlib import Path

import numpy as np

import insenv
from insenv.core.batch import make_batch
from insenv.core.runner import make_runner
from insenv.fmu.running import run
from insenv.plant.feeding import input_rows
from insenv.scenario import build, load

SCENARIO = {
    "title": "Car with a compass", "duration_s": 60, "rate_hz": 100,
    "start": {"latitude_deg": 50, "longitude_deg": 8, "height_m": 100},
    "vehicle": {"kind": "car", "legs": [
        {"wait_s": 5}, {"accelerate_to_mps": 10}, {"drive_s": 20}, {"turn_deg": 90, "radius_m": 30},
    ]},
    "imu": {"grade": "tactical"}, "gnss": {"grade": "spp", "interval_s": 1}, "compass": {"noise_deg": 0.5, "deviation_deg": 3},
    "knowledge": {"heading_error_deg": 5},
}  # fmt: skip


def main(folder: Path) -> dict:
    found = {}
    smoother = insenv.fusion([ERROR], ["gnss", "zero_velocity", COMPASS], "compass-fusion", smoother=True)
    filtered, smoothed = insenv.run(SCENARIO, ["compass-fusion", smoother]).results
    found["heading_deg"] = [float(r.errors["heading_deg"][-1]) for r in (filtered, smoothed)]
    found["sigma_deg"] = float(filtered.sigma["heading_deg"][-1])
    found["error_deg"] = float(np.degrees(filtered.outputs["compass_error"][-1, 0]))
    found["health"] = filtered.health.as_json()["aids"]["compass"]
    blind = insenv.run(SCENARIO, insenv.fusion(id="blind")).results[0]
    found["blind_sigma_deg"] = float(blind.sigma["heading_deg"][-1])
    told = {"compass-fusion": {"compass_error_sigma_deg": 0.3}}
    found["notes"] = list(insenv.run(SCENARIO, "compass-fusion", settings=told).results[0].notes)
    found["campaign"] = insenv.campaign(SCENARIO, "compass-fusion", 3, duration_s=30.0).figures()["heading_deg"]["rms"]

    plant = build(load(SCENARIO), duration_s=10.0)
    columns = plant.model.outputs.unpack(make_runner(plant.model, plant.parameters).run(plant.samples))
    columns["dt"] = np.full(plant.samples, plant.sample_interval)
    estimator = plant.adapted("compass-fusion")
    parameters = plant.parameters_of(estimator)
    rows = input_rows(estimator.model, columns, plant.samples)
    native = make_runner(estimator.model, parameters, "native").run(plant.samples, rows)
    found["interpreter_agrees"] = bool(
        np.array_equal(native, make_runner(estimator.model, parameters, "interpreter").run(plant.samples, rows))
    )
    packed = np.tile(estimator.model.parameters.pack(parameters), (3, 1))
    batch = make_batch(estimator.model, 3, packed, threads=1).run(plant.samples, np.tile(rows, (3, 1, 1)), every=1)
    found["batch_agrees"] = bool(np.array_equal(batch[1], native))
    given = {"sample_interval": plant.sample_interval, "step_is_one_increment": True}
    fmu = insenv.export_fmu("compass-fusion", folder / "compass.fmu", settings={**parameters, **given})
    stepped = run(fmu, {row.name: columns[row.name] for row in estimator.model.inputs if row.name in columns})
    shown = stepped.named()
    unpacked = estimator.model.outputs.unpack(native)
    found["fmu_agrees"] = all(
        np.array_equal(np.ravel(shown[name]), np.ravel(unpacked[name])) for name in ("q_nb", "compass_error")
    )
    return found


if __name__ == "__main__":
    from insenv_rail.compass_aid import COMPASS, ERROR

    print(json.dumps(main(Path(sys.argv[1]))))
