"""Take the installed outside package through interfaces that other processes and tools use; print what each gave as JSON.

Run by test_outside.py: `python take_through.py FOLDER`.
"""

import json
import sys
from pathlib import Path

import fmpy
import numpy as np
from places import ROOT

import insenv
from insenv.core.runner import make_runner
from insenv.plant.feeding import input_rows
from insenv.scenario import build, load

RAIL = ROOT / "tests" / "outside" / "rail" / "rail.toml"


def main(folder: Path) -> dict:
    text = (ROOT / "examples" / "n380-car.toml").read_text()
    standing = folder / "standing.toml"  # an alignment in place is refused where the car drives
    text = text.replace("[imu]", "stop_s = 160.0\n\n[imu]", 1).replace("start_s = 150.0", "")
    standing.write_text(text.replace("from_s = 350.0", "from_s = 50.0"))
    found = {"replay": insenv.replay(standing, "ahrs").results[0].statistics()["rms"]["pitch_deg"]}
    given = {"duration_s": 20.0, "vary": {"compass.deviation_deg": (-1.0, 1.0)}}
    own, workers = (insenv.campaign(RAIL, "ahrs", 9, workers=count, **given).figures() for count in (None, 1))
    found |= {"campaign": own["heading_deg"]["rms"], "workers_agree": own == workers}
    plant, estimator = build(load(RAIL), duration_s=2.0), insenv.estimators.get("ahrs")
    columns = plant.model.outputs.unpack(make_runner(plant.model, plant.parameters).run(plant.samples))
    columns["dt"], parameters = np.full(plant.samples, plant.sample_interval), plant.parameters_of(estimator)
    rows = input_rows(estimator.model, columns, plant.samples)
    native = estimator.model.outputs.unpack(make_runner(estimator.model, parameters).run(plant.samples, rows))["q_nb"]
    fmu, table = insenv.export_fmu("ahrs", folder / "ahrs.fmu", settings=parameters), estimator.model.inputs
    names = [f"{row.name}[{i + 1}]" if row.shape else row.name for row in table for i in range(max(row.size, 1))]
    signals = [(t * plant.sample_interval, *u) for t, u in enumerate(rows)]
    signals = np.array(signals, dtype=[(name, float) for name in ("time", *names)])
    shown = [f"q_nb[{i}]" for i in range(1, 5)]
    stepped = fmpy.simulate_fmu(
        str(fmu), stop_time=2.0, output_interval=plant.sample_interval, input=signals, output=shown
    )  # fmt: skip
    q_nb = np.stack([stepped[name] for name in shown], axis=1)
    found["fmpy_agrees"] = bool(np.array_equal(q_nb[1:], native[: len(q_nb) - 1]))
    return found | {"plant_fmu": insenv.export_fmu(RAIL, folder / "rail.fmu").stat().st_size}


if __name__ == "__main__":  # worker processes import this file
    print(json.dumps(main(Path(sys.argv[1]))))
