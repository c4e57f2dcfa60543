"""Other people's FMUs in `insenv.fmu.run`: the models of Reference-FMUs, built from their sources (docs/fmu.md)."""

import os
from pathlib import Path

import pytest

from insenv.errors import InputError
from insenv.fmu import run

FOLDER = os.environ.get("INSENV_REFERENCE_FMUS", "")
pytestmark = pytest.mark.skipif(
    not FOLDER,
    reason="INSENV_REFERENCE_FMUS names no folder: build Reference-FMUs as docs/fmu.md tells, with fmi2/ and fmi3/ in it",
)

RUN = {  # by version: model, stop time, and whether it ends the simulation itself
    2: {"BouncingBall": (3.0, False), "Dahlquist": (10.0, False), "Stair": (10.0, True), "VanDerPol": (20.0, False)},
    3: {"BouncingBall": (3.0, False), "Dahlquist": (10.0, False), "Feedthrough": (2.0, False), "Resource": (1.0, False),
        "Roberts": (1.0, False), "Stair": (10.0, True), "StateSpace": (10.0, False), "VanDerPol": (20.0, False)},
}  # fmt: skip
REFUSED = {2: {"Feedthrough": "declares no step", "Resource": "declares no step"},
           3: {"Clocks": "for Scheduled Execution only"}}  # fmt: skip


@pytest.mark.parametrize(("fmi", "model"), [(fmi, model) for fmi in (2, 3) for model in RUN[fmi]])
def test_a_model_runs(fmi, model):
    stop, ends = RUN[fmi][model]
    found = run(Path(FOLDER) / f"fmi{fmi}" / f"{model}.fmu", stop_time=stop)
    assert found.ended == ends
    assert len(found.time) > 0


@pytest.mark.parametrize(("fmi", "model"), [(fmi, model) for fmi in (2, 3) for model in REFUSED[fmi]])
def test_a_model_is_refused_in_one_sentence(fmi, model):
    with pytest.raises(InputError, match=REFUSED[fmi][model]):
        run(Path(FOLDER) / f"fmi{fmi}" / f"{model}.fmu")


@pytest.mark.parametrize("model", REFUSED[2])
def test_a_model_without_a_step_runs_with_one(model):
    assert len(run(Path(FOLDER) / "fmi2" / f"{model}.fmu", step=0.1, stop_time=1.0).time) == 10
