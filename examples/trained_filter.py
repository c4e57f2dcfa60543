"""A filter with a learned supervisor as one estimator: in a run, a replay, an FMU or a page, bit-identical everywhere.

    python examples/trained_filter.py supervisor/supervisor-1.npz
    python examples/trained_filter.py supervisor/supervisor-1.npz --fmu supervised.fmu

The policy is that of `examples/train_supervisor.py`: once a second it sets the white noises of the 15-state filter.  What it
sees is computed by the equations of `insenv/FaultTuning-v0`, from the filter's own inputs.
"""

import argparse
from dataclasses import replace
from types import SimpleNamespace

import casadi as ca
from compare_tuners import ARW, DECADES, STUCK_LEVEL, VRW
from train_supervisor import CLIP, FIXES, Supervisor

import insenv
from insenv import estimators
from insenv.core.compose import Part, as_part, merge
from insenv.core.elementary import clamp, exp, log, minimum, select
from insenv.core.model import Step
from insenv.core.tables import Row, Table
from insenv.envs import fault_tuning as task
from insenv.envs.embedded_filter import PREFIX, SCALE, Inner, empty_window, power10, scaled_model, window_part, within

FILTER = estimators.get("loosely-coupled")


def supervised(weights):
    """Return the estimator `supervised`: the filter with the network of these weights."""
    hidden = weights["output"].shape[1]
    state = Table((
        Row("elapsed", "Time since the start", "s"),
        Row("begins", "1 until the first decision", start=1.0),
        Row("decides", "1 on a sample after which the supervisor decides"),
        Row("held_age", "Age of the latest fix when it came", "s"),
        Row("held_sigma", "Standard deviations that it reported", "m, m/s", (6,), "n", start=1.0),
        Row("hidden", "State of the network", "1", (hidden,)),
        Row("latest", "Innovations of the latest fix over the reported standard deviations", "1", (6,), "n"),
        task._NOW,
        task.TREND,
    ))  # fmt: skip
    parameters = Table((Row("decision_samples", "Samples between decisions", start=200.0, lower=1.0, upper=1e6),))
    decide = lambda p, x, u: _decide(weights, p, x, u)  # noqa: E731
    window = window_part()
    before = Part(steps={"begin": Step(decide, when="begins")})
    after = Part(
        parameters,
        state + window.state,
        steps={
            "tick": Step(_tick),
            "hold": Step(_hold, when="gnss_valid"),
            **{name: Step(_beside(step.function), step.when) for name, step in window.steps.items()},
            "trend": Step(_beside(task.trend), when="gnss_valid"),
            "decide": Step(decide, when="decides"),
        },
    )
    model = FILTER.model
    parts = [before, as_part(scaled_model(model, task.SET)), after]
    title = "GNSS/INS, 15 states, supervised by a learned network"
    return replace(FILTER, model=merge("supervised", title, parts, model.outputs, model.output))


def _tick(p, x, u):
    return {"elapsed": x.elapsed + u.dt, "decides": x.window_samples + 1.0 >= p.decision_samples}


def _hold(p, x, u):
    return {"held_age": u.gnss_age, "held_sigma": ca.vertcat(u.gnss_position_sigma, u.gnss_velocity_sigma)}


def _view(p, x, u):
    """Return parameters and state under the names that they have in the environment, where the filter is beside a plant."""
    state = {
        **vars(x), **{PREFIX + name: value for name, value in vars(x).items()}, "imu_valid": 1.0, "time": x.elapsed,
        "delta_angle": u.delta_angle, "delta_velocity": u.delta_velocity, "gnss_age": x.held_age,
        "gnss_position_sigma": x.held_sigma[:3], "gnss_velocity_sigma": x.held_sigma[3:],
    }  # fmt: skip
    known = {f"known_{name}": getattr(p, name) for name in task.SET[:2]}
    return SimpleNamespace(**vars(p), **known, sample_interval=u.dt), SimpleNamespace(**state)


def _beside(function):
    return lambda p, x, u: function(*_view(p, x, u), u)


def _decide(w, p, x, u):
    seen = task.observed(Inner(FILTER, FILTER.model), *_view(p, x, u))
    seen = within(task.OBSERVED, seen | {"action_now": x.action_now})
    action = ca.SX.zeros(9)
    for place, name in ((ARW, "gyro_level"), (VRW, "accel_level")):
        action[place] = _from_scatter(seen[name])
    some = seen["fixes"] > 0.0
    innovation = some * _sign(seen["ratio"]) * power10(seen["innovation_level"])
    change = some * (innovation - x.latest)
    observed = ca.vertcat(*(seen[name] for name in task.OBSERVED.names), _arcsinh(innovation), _arcsinh(change))
    inputs = clamp((observed - w["mean"]) / w["scale"], -CLIP, CLIP)
    given = ca.vertsplit(ca.mtimes(w["input"], inputs) + w["input_offset"], x.hidden.numel())
    held = ca.vertsplit(ca.mtimes(w["recurrent"], x.hidden) + w["recurrent_offset"], x.hidden.numel())
    reset, update = (1.0 / (1.0 + exp(-(a + b))) for a, b in zip(given[:2], held[:2], strict=True))
    new = 1.0 - 2.0 / (exp(2.0 * (given[2] + reset * held[2])) + 1.0)  # the hyperbolic tangent
    hidden = x.hidden + (1.0 - update) * (new - x.hidden)
    action[FIXES] = clamp(ca.mtimes(w["output"], hidden) + w["output_offset"], -1.0, 1.0)
    return {
        SCALE: power10(DECADES * action[:7]), "action_now": action, "hidden": hidden, "begins": 0.0, "decides": 0.0,
        "latest": select(some, innovation, x.latest), **empty_window(),
    }  # fmt: skip


def _from_scatter(level):
    """Return the action of `compare_tuners.FromScatter` on the white noise of three axes."""
    quiet = level < STUCK_LEVEL
    several = 1.0 - quiet[0] * quiet[1] * quiet[2]  # before the first sample no axis scatters
    stuck = quiet * several
    level = select(stuck, 1e3, select(quiet, 0.0, level))
    least = minimum(minimum(level[0], level[1]), level[2])
    return select(ca.sum1(stuck) > 0.0, 1.0, clamp(least / DECADES, -0.5, 1.0))


def _sign(x):
    return select(x < 0.0, -1.0, x > 0.0)


def _arcsinh(x):
    size = ca.fabs(x)
    return _sign(x) * log(size + ca.sqrt(size * size + 1.0))


def tuned_as_the_filter(scenario, id):
    """Return the scenario with what it sets for the filter set for the estimator `id` too."""
    return scenario.model_copy(update={"estimator": {**scenario.estimator, id: scenario.estimator.get(FILTER.id, {})}})


def main():
    parser = argparse.ArgumentParser(description="Run or export a filter with a learned supervisor")
    parser.add_argument("policy", help="file of a policy, of train_supervisor.py")
    parser.add_argument("--scenario", default="car-city-drive")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--fmu", help="file of an FMU to write")
    given = parser.parse_args()
    estimator = supervised(Supervisor.load(given.policy).weights)
    if given.fmu:
        print(insenv.export_fmu(estimator, given.fmu))
    else:
        print(
            insenv.run(tuned_as_the_filter(insenv.load(given.scenario), estimator.id), [FILTER.id, estimator], seed=given.seed)
        )


if __name__ == "__main__":
    main()
