"""`insenv prove`, with a simulated drive in the place of the data of a public log."""

import json
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import peers
import pytest
from changed_scenario import changed
from command_line import call, refused, strict
from places import ROOT
from simulated_log import simulated_log

from insenv.evaluation.outages import Outage, Outages
from insenv.report.console import as_text
from insenv.studies import proof
from insenv.studies.proof import prove
from insenv.studies.proof_result import Compared, Judged, LogProof, Proof, Withheld, summary

RECORD = json.loads((ROOT / "tests" / "studies" / "proof.json").read_text("utf-8"))
NAME, FOLDER = "kf-gins-leador", "KF-GINS/dataset"


@pytest.fixture(scope="module")
def data(tmp_path_factory):
    """The survey drive, 380 s, in files as those of KF-GINS, with the lever arm of its description."""
    folder = tmp_path_factory.mktemp("data")
    (folder / FOLDER).mkdir(parents=True)
    gnss = {"lever_arm_m": [0.136, -0.301, -0.184], "outages_s": []}
    log = simulated_log(changed("car-survey", rate_hz=100.0, gnss=gnss), seed=5, duration_s=380.0)
    fixes, true, week = log.gnss, log.reference, 456250.0
    place = [np.degrees(fixes.latitude), np.degrees(fixes.longitude), fixes.height]
    angles = [np.degrees(each) for each in (true.roll, true.pitch, true.heading)]
    there = [np.degrees(true.latitude), np.degrees(true.longitude), true.height, *true.velocity_n.T]
    files = {
        "Leador-A15.txt": [log.imu_time + week, *log.delta_angle.T, *log.delta_velocity.T],
        "GNSS-RTK.txt": [fixes.time + week, *place, *fixes.position_sigma.T],
        "truth.nav": [np.full(len(true.time), 2017.0), true.time + week, *there, *angles],
    }
    for name, columns in files.items():
        np.savetxt(folder / FOLDER / name, np.column_stack(columns), fmt="%.12g")
    return folder


def test_a_log_is_judged_by_its_reference_and_by_withheld_fixes(data, monkeypatch):
    monkeypatch.setattr(proof, "ESTIMATORS", ("loosely-coupled", "q-method"))
    status, out, err = call("prove", NAME, "--data", data, "--json")
    (log,) = strict(out)["logs"]
    filtered, alignment = log["runs"]
    assert (status, err, log["used"], log["grade"], log["missing"]) == (0, "", "reported on", "leador", "")
    assert "q-method" in alignment["refused"] and alignment["errors"] == {}
    assert filtered["errors"]["north_m"]["rms"] < 0.03 and filtered["errors"]["heading_deg"]["rms"] < 0.5
    lost, again = filtered["withheld"], Proof.of_json(json.loads(out))
    assert lost["outages"] == 1 and 0.05 < lost["largest"]["horizontal_m"] < 20.0 and 0.0 < lost["ratio"] < 3.0
    assert lost["errors"]["horizontal_m"]["rms"] > 3 * filtered["errors"]["north_m"]["rms"]
    shown = as_text(again.document().blocks())
    assert "left out" in shown and "0 of 1 runs" in shown


def test_of_an_outage_the_error_at_its_end_and_the_largest_are_kept():
    outage = Outage(0.0, 2.0, np.arange(2.0), np.array([[3.0, 4.0, 9.0], [0.6, 0.8, 2.0]]), np.full((2, 3), 0.5))
    found = proof._withheld(SimpleNamespace(outages=Outages((outage,)), health=None, notes=()))
    assert {name: each.rms for name, each in found.errors.items()} == pytest.approx({"horizontal_m": 1.0, "down_m": 2.0})
    assert found.largest == pytest.approx({"horizontal_m": 5.0, "down_m": 9.0})


def test_what_is_not_there_is_said_in_one_sentence(data, tmp_path, monkeypatch):
    status, out, _ = call("prove", NAME, "--data", tmp_path, "--json")
    (missing,) = (log["missing"] for log in strict(out)["logs"])
    assert status == 1 and f"its data are not here: {FOLDER}/Leador-A15.txt" in missing and "git clone" in missing
    (tmp_path / FOLDER).mkdir(parents=True)
    for name in ("Leador-A15.txt", "truth.nav"):
        (tmp_path / FOLDER / name).symlink_to(data / FOLDER / name)
    missing = prove([NAME], tmp_path).logs[0].missing
    assert f"1 of its 3 files are not here: {FOLDER}/GNSS-RTK.txt; `git clone" in missing and str(tmp_path) in missing
    (tmp_path / FOLDER / "GNSS-RTK.txt").write_text("no numbers\n")
    refused(call("prove", NAME, "--data", tmp_path), "GNSS-RTK.txt")
    monkeypatch.setattr(proof, "is_there", lambda name, folder: False)
    assert "its data are not here: package:onavdata; `pip install" in proof.public_logs()["umn-thor-75"].missing(tmp_path)


@pytest.mark.parametrize(("names", "gone", "status"), [
    ((), (), 0), ((), ("first",), 0), ((), ("first", "second"), 1),
    (("first", "second"), (), 0), (("first", "second"), ("second",), 1), (("first",), ("first",), 1),
])  # fmt: skip
def test_the_status_is_1_where_a_named_log_or_every_log_is_missing(names, gone, status, tmp_path, monkeypatch):
    """Of all logs, some may be missing: who asks for all of them runs those that are there."""

    def prove(asked, data, progress):
        logs = (LogProof(name, "", "", "", "reported on", "", missing=name if name in gone else "")
                for name in asked or ("first", "second"))  # fmt: skip
        return Proof("", tuple(logs))

    monkeypatch.setattr(proof, "prove", prove)
    found, out, err = call("prove", *names, "--data", tmp_path, "--json")
    assert (found, err) == (status, "") and [log["missing"] for log in strict(out)["logs"] if log["missing"]] == list(gone)


def test_a_run_that_states_too_little_counts_as_silent_unless_it_says_so():
    over = {"heading_deg": Compared(3.0, 0.5, 0.02)}
    lost = Withheld(2, 4.0, {"horizontal_m": Compared(9.0, 2.0, 0.3)}, {"horizontal_m": 9.0}, "consistent", False)
    said = [Judged("fusion", warned=warned, errors=over, withheld=each) for warned in (False, True) for each in (None, lost)]
    assert [run.silent for run in said] == [True, True, False, True]
    named = replace(said[2], verdict="contradicted", by_reference=True)
    (line,) = summary(Proof("", (LogProof("drive", "", "", "", "reported on", "", runs=(said[0], named)),)))
    assert "2 of 2 runs" in line and "1 of these do not say so: drive fusion; 1 say so only because of their reference" in line


@pytest.mark.slow
def test_the_recorded_results_are_those_of_the_code():
    peers.package("onavdata")
    found = prove(["n380-stoplight", "umn-thor-75"])
    kept = Proof(found.insenv,
        tuple(log for log in Proof.of_json(RECORD).logs if log.name in ("n380-stoplight", "umn-thor-75")))  # fmt: skip
    printed, expected = (as_text(each.document().blocks()) for each in (found, kept))
    assert printed == expected, "insenv prove --json > tests/studies/proof.json"


def test_every_description_has_its_licence_and_source_and_the_record_is_of_these_logs():
    known = proof.public_logs()
    assert all(log.description["licence"] and log.description["source"] and log.get for log in known.values())
    assert {log["name"]: log["used"] for log in RECORD["logs"]} == {log.name: log.used for log in known.values()}
