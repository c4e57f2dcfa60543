"""Options that several commands share."""

import pytest
from command_line import ROOT, call, refused, strict

PLAIN = ROOT / "examples" / "logs" / "plain.toml"


def test_an_empty_path_is_refused():
    for line in (
        "run ship-swaying --out",
        f"replay {PLAIN} -e loosely-coupled -o",
        "stream ship-swaying --to udpout:127.0.0.1:14550 --tlog",
        "new scenario",
    ):
        refused(call(*line.split(), ""), "is empty: allowed is a path")


@pytest.mark.parametrize("command", [("budget", "ship-swaying"), ("fmu", "export", "ship-swaying", "-o", "x.fmu")])
def test_a_command_that_runs_one_estimator_refuses_two(command, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    refused(call(*command, "-e", "q-method", "-e", "analytic"), "-e q-method -e analytic: allowed is one estimator")
    assert not list(tmp_path.iterdir())


CAR = ("run", "car-city-drive", "-e", "loosely-coupled", "--duration", "5", "--json")


def numbers(answer):
    """The results of a run in JSON, less what differs from call to call; and the notes."""
    status, out, err = answer
    assert (status, err) == (0, "")
    document = strict(out)
    notes = document["notes"]
    return [{name: result[name] for name in ("rms", "max", "final")} for result in document["results"]], notes


def test_set_changes_a_key_as_the_file_does(tmp_path):
    """Of a scenario, of a log and of a stream, and says so; the parameter of an estimator is meant by both its names."""
    keys = ("--set", "imu.grade=industrial", "--set", "gnss.position_noise_m=[2, 2, 4]")
    settings, text = "loosely-coupled.innovation_gate=4", (ROOT / "scenarios" / "car-city-drive.toml").read_text()
    for before, after in (('grade = "tactical"', 'grade = "industrial"'), ("[gnss]", "[gnss]\nposition_noise_m = [2, 2, 4]")):
        assert before in text
        text = text.replace(before, after)
    file = tmp_path / "car-city-drive.toml"
    file.write_text(text)
    found, notes = numbers(call(*CAR, *keys, "--set", settings))
    assert (found, notes[1:]) == numbers(call("run", file, *CAR[2:], "--set", f"estimator.{settings}"))
    assert notes[0] == 'changed by --set: imu.grade = "industrial", gnss.position_noise_m = [2, 2, 4]'
    assert found != numbers(call(*CAR))[0]

    log = ("replay", PLAIN, "-e", "loosely-coupled", "--json")
    other, notes = numbers(call(*log, "--set", "gnss.height_offset_m=0.5"))
    assert notes[0] == "changed by --set: gnss.height_offset_m = 0.5" and other != numbers(call(*log))[0]
    streamed = ("stream", "car-city-drive", "--to", "udpout:127.0.0.1:14999", "--speed", "0", "--duration", "0.1", "--set")
    assert call(*streamed, "imu.grade=tactical")[0] == 0
    refused(call(*streamed, "imu.grade=tactica"), "imu.grade = 'tactica'", "did you mean 'tactical'")


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("imu.grad=3", ["--set: imu.grad: unknown key", "did you mean 'grade'"]),
        ("imux.grade=3", ["no key or estimator 'imux'", "did you mean 'imu'"]),
        ("loosly-coupled.innovation_gate=3", ["did you mean 'loosely-coupled'"]),
        ("loosely-coupled.innovation_gat=3", ["loosely-coupled.innovation_gat: unknown key", "'innovation_gate'"]),
        ("loosely-coupled=3", ["allowed is loosely-coupled.KEY=VALUE"]),
        ("imu.grade.x=3", ["imu.grade = 'tactical' is a value, not a table"]),
        ("vehicle.legs.99.speed_mps=3", ["vehicle.legs is a list of", "allowed is an element from 0 to"]),
        ("gnss.interval_s=-1", ["gnss.interval_s = -1 [s]", "greater than 0"]),
        ("imu.grade", ["'imu.grade'", "allowed is KEY=VALUE"]),
        ("imu..grade=3", ["allowed is KEY=VALUE"]),
    ],
)
def test_a_wrong_key_to_set_is_named_with_the_nearest(text, words):
    refused(call(*CAR[:-1], "--set", text), *words)
