"""Exported FMUs, inputs of a simulated run, and the outputs of the model in process."""

import functools
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from places import scratch

from insenv import estimators
from insenv.base.resources import fmu_folder
from insenv.core.runner import make_runner
from insenv.fmu import export_fmu
from insenv.fmu.subject import Subject, subject
from insenv.scenario import USUAL, build, load
from insenv.scenario.inputs import input_rows

INTERVAL = 0.005
"""Sample interval of the scenarios used here, s."""

LOOP = "car-parked+qakf-improved"


def subject_of(what: str) -> Subject:
    """What an FMU holds: an estimator, a scenario's plant, or SCENARIO+ESTIMATOR."""
    scenario, _, estimator = what.partition("+")
    return subject(scenario, {}, estimator or None)


def exported(what: str, fmi: int = 2, platforms: tuple[str, ...] = ("host",), **options) -> Path:
    path = scratch() / f"{'-'.join(map(str, (what, fmi, *platforms, *options.values())))}.fmu"
    if not path.exists():
        scenario, _, estimator = what.partition("+")
        export_fmu(scenario, path, estimator=estimator or None, fmi=fmi, platforms=platforms, **options)
    return path


def unzipped(*what, **options) -> Path:
    path = exported(*what, **options)
    if not path.with_suffix("").exists():
        shutil.unpack_archive(path, path.with_suffix(""), "zip")
    return path.with_suffix("")


@functools.cache
def plant_outputs(scenario: str, samples: int) -> dict[str, np.ndarray]:
    plant = build(load(scenario))
    assert plant.sample_interval == INTERVAL
    shown = plant.model.outputs.unpack(make_runner(plant.model, plant.parameters).run(samples))
    return {name: np.array(column) for name, column in shown.items()}


def _exported(id: str) -> estimators.Estimator:
    """The estimator that an FMU holds: of a family the member for the scenario of its kind."""
    family = estimators.get(id)
    return build(load(USUAL[family.kind])).adapted(family)


def columns_for(id: str, samples: int) -> dict[str, np.ndarray]:
    """Inputs of an estimator's FMU by name: the sensor outputs of a scenario of its kind."""
    estimator = _exported(id)
    shown = plant_outputs(USUAL[estimator.kind], samples)
    return {name: shown[name] for name in estimator.model.inputs.names if name in shown}


def in_process(id: str, columns: dict[str, np.ndarray], parameters: dict | None = None) -> np.ndarray:
    """The estimator's outputs after each sample, (samples, outputs), from insenv's runner."""
    estimator, count = _exported(id), len(next(iter(columns.values())))
    plant = build(load(USUAL[estimator.kind]))
    rows = estimator.parameters(plant.knowledge, plant.tunings)
    columns = {**columns, "dt": np.full(count, INTERVAL)}
    return make_runner(estimator.model, {**rows, **(parameters or {})}).run(count, input_rows(estimator.model, columns, count))


def c_compiler() -> str:
    found = next(filter(None, map(shutil.which, ("cc", "gcc", "clang"))), None)
    return found or pytest.skip("no C compiler (cc, gcc, clang) on the path")


@functools.cache
def host_binary() -> Path:
    """fmu/examples/host.c, compiled as documented."""
    binary = scratch() / "host"
    libraries = [] if sys.platform == "win32" else ["-ldl", "-lm"]
    source = fmu_folder() / "examples" / "host.c"
    strict = ["-Wall", "-Wextra", "-Wpedantic", "-Werror"]
    subprocess.run([c_compiler(), "-std=c99", "-O2", *strict, str(source), "-o", str(binary), *libraries], check=True)
    return binary
