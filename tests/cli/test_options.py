"""Options that several commands share."""

import socket

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


RUN, STREAM = "run ship-swaying --duration 2", "stream car-city-drive --duration 1 --to"


@pytest.mark.parametrize(
    ("line", "said"),
    [
        ("budget ship-swaying -e q-method -e analytic", "-e q-method -e analytic: allowed is one estimator"),
        ("fmu export ship-swaying -o x.fmu -e q-method -e analytic", "-e q-method -e analytic: allowed is one estimator"),
        (f"{RUN} --seed 1 --seed 2", "--seed is given 2 times: allowed is once"),
        ("fmu export q-method -o x.fmu -o y.fmu", "--output is given 2 times"),
        ("budget ship-swaying -e q-method -n 1", "runs = 1: allowed is a whole number from 2"),
        (f"{RUN} --seed 1.5", "--seed 1.5: allowed is a whole number"),
        ("run ship-swaying --duration=5m", "--duration 5m: allowed is a number"),
        ("campaign ship-swaying -e q-method -n2.5", "--runs 2.5: allowed is a whole number"),
        ("campaign ship-swaying -e q-method", "--runs N is missing: Number of runs"),
        ("new", "scenario|log is missing: allowed is insenv new [OPTIONS] scenario|log FILE"),
        ("new scenario", "FILE is missing"),
        ("new scenario x.toml y.toml", "unexpected argument 'y.toml': allowed is insenv new"),
        ("examples file", "cannot write to the folder 'file': it is a file"),
        ("run doubled.toml", "line 3 gives a key or table that the file has before: allowed is each once"),
        ("bench --only nope", "no figure starts with 'nope' (allowed: native, interpreter, batch"),
        (f"{RUN} --set imu.grade=super", "'super': unknown (allowed"),
        (f"{STREAM} foo", "address 'foo': must be udpout:HOST:PORT"),
    ],
)
def test_a_wrong_call_is_one_sentence_with_the_value_and_what_is_allowed(line, said, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("insenv.mavlink.Vehicle", lambda *_, **__: pytest.fail("the work was begun"))
    for name, text in (("file", ""), ("doubled.toml", "seed = 1\nrate_hz = 1.0\nseed = 2\n")):
        (tmp_path / name).write_text(text)
    refused(call(*line.split()), said)
    assert len(list(tmp_path.iterdir())) == 2


@pytest.mark.parametrize(
    ("line", "path"),
    [
        (f"{RUN} -o out", "'out'"),
        ("new scenario x.toml", "'x.toml'"),
        ("examples new", "'new'"),
        ("page ship-swaying -o x.html", "x.html"),
        ("fmu export q-method -o x.fmu", "x.fmu"),
        (f"allan {PLAIN} --grade g.toml", "g.toml"),
    ],
)
def test_a_full_disk_is_status_1_and_names_the_path(line, path, tmp_path, monkeypatch):
    def full(*_, **__):
        raise OSError(28, "No space left on device")

    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("insenv.base.output.os.replace", full)
    refused(call(*line.split()), path, "No space left on device", status=1)
    assert not [each for each in tmp_path.rglob("*") if each.is_file()]


def test_a_tcp_link_that_nobody_accepts_is_failed_work():
    with socket.create_server(("127.0.0.1", 0)) as free:
        port = free.getsockname()[1]
    status, _, err = call(*STREAM.split(), f"tcpout:127.0.0.1:{port}", "--speed", "0")
    assert status == 1 and f"nobody accepted a connection at tcpout:127.0.0.1:{port}" in err


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
