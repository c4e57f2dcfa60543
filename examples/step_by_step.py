"""Step by step: a plant and an estimator, each on a runner, in a plain loop over inertial samples.

    python examples/step_by_step.py

A car drives for a minute and a half, the last ten seconds without GNSS; the loop prints the filter's error beside the sigma
that it states.  Inputs and outputs are passed by name; `print(estimator.model.inputs.names)` shows the names.
"""

import numpy as np

from insenv import estimators, geodesy
from insenv.core.runner import make_runner
from insenv.scenario import build, load

plant = build(load("car-city-drive"), seed=3)
estimator = estimators.get("loosely-coupled")

car = make_runner(plant.model, plant.parameters)
navigator = make_runner(estimator.model, estimator.parameters(plant.knowledge))
fix = [name for name in estimator.model.inputs.names if name.startswith("gnss_")]

print("  time  horizontal error   stated sigma")
for sample in range(1, 90 * 200 + 1):
    car.advance()
    shown = car.outputs()
    inputs = {name: shown[name] for name in ("delta_angle", "delta_velocity")}
    inputs |= {"dt": plant.sample_interval, "gnss_valid": 0.0}
    if shown["gnss_valid"] and shown["time"] <= 80.0:
        inputs |= {name: shown[name] for name in fix}
    navigator.advance(inputs)

    if sample % 2000 == 0:
        found = navigator.outputs()
        place = (found["latitude"], found["longitude"], found["height"])
        error = geodesy.numeric.ned_offset(*place, shown["latitude"], shown["longitude"], shown["height"])
        sigma = found["position_sigma"]
        print(f"{shown['time']:4.0f} s  {np.hypot(*error[:2]):13.2f} m  {np.hypot(*sigma[:2]):11.2f} m")
