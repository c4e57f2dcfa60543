"""Take the outside package through every interface of insenv; print what each gave as JSON.  Run by test_outside.py."""

import json
import sys
from pathlib import Path

import fmpy
import numpy as np
from places import ROOT

import insenv
from insenv.core.runner import make_runner
from insenv.envs import AlignmentEnv, AlignmentVectorEnv, agents
from insenv.plant.feeding import input_rows
from insenv.scenario import build, load

SCENARIO = ROOT / "tests" / "outside" / "rail" / "rail.toml"


def main(folder: Path) -> dict:
    found = {}

    report = insenv.run(SCENARIO, "ahrs", duration_s=20.0)
    found["run"] = report.results[0].statistics()["rms"]

    text = (ROOT / "examples" / "n380-car.toml").read_text()
    standing = folder / "standing.toml"  # an alignment in place is refused where the car drives
    standing.write_text(
        text.replace("[imu]", "stop_s = 160.0\n\n[imu]", 1)
        .replace("start_s = 150.0", "")
        .replace("from_s = 350.0", "from_s = 50.0")
    )
    replayed = insenv.replay(standing, "ahrs").results[0]
    found["replay"] = replayed.statistics()["rms"]["pitch_deg"]

    summary = insenv.campaign(SCENARIO, "ahrs", 9, duration_s=20.0, workers=1, vary={"compass.deviation_deg": (-1.0, 1.0)})
    found["campaign"] = summary.figures()["heading_deg"]["rms"]
    same = insenv.campaign(SCENARIO, "ahrs", 9, duration_s=20.0, vary={"compass.deviation_deg": (-1.0, 1.0)})
    found["workers_agree"] = same.figures() == summary.figures()

    single = AlignmentEnv(SCENARIO, samples_per_step=50, duration_s=10.0)
    batch = AlignmentVectorEnv(9, SCENARIO, samples_per_step=50, duration_s=10.0)
    one, many = agents.make("ahrs", single), agents.make("ahrs", batch)
    (observation, info), (observations, infos) = single.reset(seed=4), batch.reset(seed=4)
    agree = True
    for _ in range(30):
        action, actions = one.act(observation, info), many.act(observations, infos)
        agree &= np.array_equal(action, actions[0])
        observation, *_, info = single.step(action)
        observations, *_, infos = batch.step(actions)
        agree &= np.array_equal(observation, observations[0])
    found["batch_of_9_agrees"] = bool(agree)
    found["window"] = list(single.named(observation)["imu"].shape)

    plant = build(load(SCENARIO), duration_s=2.0)
    columns = plant.model.outputs.unpack(make_runner(plant.model, plant.parameters).run(plant.samples))
    columns["dt"] = np.full(plant.samples, plant.sample_interval)
    estimator = insenv.estimators.get("ahrs")
    parameters = plant.parameters_of(estimator)
    rows = input_rows(estimator.model, columns, plant.samples)
    native = estimator.model.outputs.unpack(make_runner(estimator.model, parameters).run(plant.samples, rows))["q_nb"]
    fmu = insenv.export_fmu("ahrs", folder / "ahrs.fmu", settings=parameters)
    names = [
        f"{row.name}[{i + 1}]" if row.shape else row.name for row in estimator.model.inputs for i in range(max(row.size, 1))
    ]
    time = np.arange(plant.samples) * plant.sample_interval
    signals = np.array(
        [(t, *u) for t, u in zip(time, rows, strict=True)], dtype=[("time", float), *((name, float) for name in names)]
    )
    stepped = fmpy.simulate_fmu(
        str(fmu),
        stop_time=2.0,
        output_interval=plant.sample_interval,
        input=signals,
        output=[f"q_nb[{i}]" for i in range(1, 5)],
    )
    q_nb = np.stack([stepped[f"q_nb[{i}]"] for i in range(1, 5)], axis=1)
    found["fmpy_agrees"] = bool(np.array_equal(q_nb[1:], native[: len(q_nb) - 1]))
    found["plant_fmu"] = insenv.export_fmu(SCENARIO, folder / "rail.fmu").stat().st_size

    return found


if __name__ == "__main__":  # worker processes import this file
    print(json.dumps(main(Path(sys.argv[1]))))
