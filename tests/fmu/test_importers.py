"""The models of Reference-FMUs in `insenv.fmu.run`, and our FMUs in its importer fmusim; docs/fmu.md builds both."""

import csv
import os
import subprocess
from pathlib import Path
from zipfile import ZipFile

import pytest

from insenv.errors import InputError
from insenv.fmu import export_fmu, run

FOLDER = os.environ.get("INSENV_REFERENCE_FMUS", "")
FMUSIM = os.environ.get("INSENV_FMUSIM", "")
reference_fmus = pytest.mark.skipif(
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


@reference_fmus
@pytest.mark.parametrize(("fmi", "model"), [(fmi, model) for fmi in (2, 3) for model in RUN[fmi]])
def test_a_model_runs(fmi, model):
    stop, ends = RUN[fmi][model]
    found = run(Path(FOLDER) / f"fmi{fmi}" / f"{model}.fmu", stop_time=stop)
    assert found.ended == ends
    assert len(found.time) > 0


@reference_fmus
@pytest.mark.parametrize(("fmi", "model"), [(fmi, model) for fmi in (2, 3) for model in REFUSED[fmi]])
def test_a_model_is_refused_in_one_sentence(fmi, model):
    with pytest.raises(InputError, match=REFUSED[fmi][model]):
        run(Path(FOLDER) / f"fmi{fmi}" / f"{model}.fmu")


@reference_fmus
@pytest.mark.parametrize("model", REFUSED[2])
def test_a_model_without_a_step_runs_with_one(model):
    assert len(run(Path(FOLDER) / "fmi2" / f"{model}.fmu", step=0.1, stop_time=1.0).time) == 10


@pytest.mark.skipif(not FMUSIM, reason="INSENV_FMUSIM names no binary: build fmusim as docs/fmu.md tells")
@pytest.mark.parametrize(
    ("what", "options"),
    [
        ("loosely-coupled", {"fmi": 2}),
        ("loosely-coupled", {"fmi": 3}),
        ("loosely-coupled", {"fmi": 3, "arrays": False}),
        ("ship-swaying", {"fmi": 2}),
        ("ship-swaying", {"fmi": 2, "estimator": "qakf-improved"}),
    ],
)
def test_fmusim_gives_the_reference_signals_at_its_default_step(tmp_path, what, options):
    path = export_fmu(what, tmp_path / "x.fmu", **options)
    with ZipFile(path) as archive:
        for name in archive.namelist():
            if name.endswith((".csv",)):
                (tmp_path / Path(name).name).write_bytes(archive.read(name))
    given = ["--input-file", str(tmp_path / "in.csv")] if (tmp_path / "in.csv").exists() else []
    command = [FMUSIM, *given, "--stop-time", "1.5", "--output-file", str(tmp_path / "out.csv"), str(path)]
    subprocess.run(command, check=True, capture_output=True, timeout=120)
    found, wanted = (list(csv.DictReader((tmp_path / name).read_text().splitlines())) for name in ("out.csv", "ref.csv"))
    assert len(found) == 301
    for row, reference in zip(found[::10], wanted, strict=True):
        for name in set(reference) - {"time"}:  # fmusim writes 16 digits
            for a, b in zip(row[name].split(), reference[name].split(), strict=True):
                assert float(a) == pytest.approx(float(b), rel=1e-15, abs=0)


@pytest.mark.skipif(not FMUSIM, reason="INSENV_FMUSIM names no binary: build fmusim as docs/fmu.md tells")
def test_fmusim_shows_the_reason_for_a_refused_step(tmp_path):
    path = export_fmu("q-method", tmp_path / "x.fmu")
    command = [FMUSIM, "--stop-time", "1", "--output-interval", "0.1", str(path)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=120, cwd=tmp_path)
    assert "communication step is 0.1 s: allowed is one sample interval, 0.005 s" in done.stdout + done.stderr
