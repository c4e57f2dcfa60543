"""Options that several commands share."""

import shlex
import socket
from pathlib import Path

import pytest
from command_line import ROOT, call, refused, strict

from insenv.base.changes import parsed
from insenv.base.toml import read_toml

PLAIN = ROOT / "examples" / "logs" / "plain.toml"
RUN, STREAM = "run ship-swaying --duration 2", "stream car-city-drive --duration 1 --to"
WRONG = read_toml(Path(__file__).with_name("wrong_calls.toml"))


def placed(text):
    return (
        text.replace("PLAIN", str(PLAIN))
        .replace("LOGS", str(PLAIN.parent))
        .replace("SCENARIO", f"{ROOT}/scenarios/car-odometer.toml")
    )


@pytest.mark.parametrize("line", WRONG)
def test_a_wrong_call_is_one_sentence_with_the_value_and_what_is_allowed(line, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("insenv.mavlink.Vehicle", lambda *_, **__: pytest.fail("the work was begun"))
    files = {"file": "", "doubled.toml": "seed = 1\nrate_hz = 1.0\nseed = 2\n", "grade.toml": "gyro_arw_deg_sqrt_h = 0.1\n"}
    for name, text in files.items():
        (tmp_path / name).write_text(text)
    refused(call(*shlex.split(placed(line))), *map(placed, WRONG[line]))
    assert len(list(tmp_path.iterdir())) == len(files)


FULL = {f"{RUN} --no-figure -o out": "'out'", "examples new": "'new'", "fmu export q-method -o x.fmu": "x.fmu"}


@pytest.mark.parametrize("line", [*FULL, f"allan {PLAIN} --from 0 --to 25 --grade-out g.toml"])
def test_a_full_disk_is_status_1_and_names_the_path(line, tmp_path, monkeypatch):
    def full(*_, **__):
        raise OSError(28, "No space left on device")

    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("insenv.base.output.os.replace", full)
    refused(call(*line.split()), FULL.get(line, "g.toml"), "No space left on device", status=1)
    assert not [each for each in tmp_path.rglob("*") if each.is_file()]


def test_a_tcp_link_that_nobody_accepts_is_failed_work():
    with socket.create_server(("127.0.0.1", 0)) as free:
        port = free.getsockname()[1]
    status, _, err = call(*STREAM.split(), f"tcpout:127.0.0.1:{port}", "--speed", "0")
    assert status == 1 and f"nobody accepted a connection at tcpout:127.0.0.1:{port}" in err


def test_set_changes_a_key_as_the_file_does(tmp_path):
    """Of a scenario, of a log and of a stream, and says so; the parameter of an estimator is meant by both its names."""

    def run(*arguments):
        document = strict(call(*arguments, "--json")[1])
        return document["results"][0]["rms"], document["notes"]

    car, rest = ("run", "car-city-drive"), ("-e", "loosely-coupled", "--duration", "5")
    text, file = (ROOT / "scenarios" / "car-city-drive.toml").read_text(), tmp_path / "car-city-drive.toml"
    file.write_text(text.replace('grade = "tactical"', 'grade = "industrial"').replace("[gnss]", "[gnss]\nvelocity = false"))
    gate = "loosely-coupled.innovation_gate=4"
    found, notes = run(*car, *rest, "--set", "imu.grade=industrial", "--set", "gnss.velocity=false", "--set", gate)
    assert (found, notes[1:]) == run("run", file, *rest, "--set", f"estimator.{gate}") and found != run(*car, *rest)[0]
    assert notes[0] == 'changed by --set: imu.grade = "industrial", gnss.velocity = false'
    log = ("replay", PLAIN, "-e", "loosely-coupled")
    other, notes = run(*log, "--set", "gnss.height_offset_m=0.5")
    assert notes[0] == "changed by --set: gnss.height_offset_m = 0.5" and other != run(*log)[0]
    assert call(*STREAM.split(), "udpout:127.0.0.1:14999", "--speed", "0", "--set", "imu.grade=tactical")[0] == 0


@pytest.mark.parametrize(("text", "value"), [
    ("[{wait_s = 60}, {speed_mps = 3.5}]", [{"wait_s": 60}, {"speed_mps": 3.5}]), ('[{"wait_s": 60}]', [{"wait_s": 60}]),
    ("{a = [1, 2.5]}", {"a": [1, 2.5]}), ("true", True), ("2e3", 2000.0), ("tactical", "tactical"), ("[broken", "[broken"),
])  # fmt: skip
def test_set_takes_lists_and_tables_as_a_scenario_writes_them(text, value):
    assert parsed([f"vehicle.legs={text}"]) == {"vehicle.legs": value}
