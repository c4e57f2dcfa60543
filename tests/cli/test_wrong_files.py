"""Files that are something else say what they are, and what the command takes."""

import gzip

import pytest
from command_line import ROOT, call, refused

PLAIN = ROOT / "examples" / "logs" / "plain.toml"
SCENARIO = ROOT / "scenarios" / "ship-swaying.toml"
OWN = ROOT / "examples" / "own_scenario.toml"


def run(file):
    return call("run", file, "--duration", 5)


def replay(file):
    return call("replay", file, "-e", "q-method")


def test_run_and_replay_given_the_file_of_the_other():
    refused(run(PLAIN), "describes a recorded log", f"insenv replay {PLAIN} -e ID")
    refused(replay(SCENARIO), "a scenario, not the description of a recorded log", f"insenv run {SCENARIO}")
    refused(replay("ship-swaying"), "a scenario, not a recorded log", "insenv run ship-swaying")
    refused(run(PLAIN.parent / "px4-takeoff.ulg.gz"), "not a scenario", "insenv replay")


def test_a_folder_is_named_with_what_is_allowed(tmp_path):
    refused(replay(tmp_path), "a folder, not a TOML file; allowed is a .toml file that describes a log, or a flight log")
    (tmp_path / "mine.toml").mkdir()
    refused(run(tmp_path / "mine.toml"), "mine.toml: a folder, not a TOML file")


def test_a_raw_table_says_what_it_needs(tmp_path):
    for name in ("plain-imu.csv", "plain-gnss.csv"):
        refused(replay(PLAIN.parent / name), name, "a table of numbers", "insenv new log FILE", "docs/logs.md")
        refused(run(PLAIN.parent / name), name, "not a scenario", "insenv replay")
    (tmp_path / "kf.txt").write_text("1.0 0.1 0.2 0.3 0 0 -9.8\n1.1 0.1 0.2 0.3 0 0 -9.8\n")
    refused(replay(tmp_path / "kf.txt"), "a table of numbers")


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (b"", ["the file is empty"]),
        (b" \n\n", ["the file is empty"]),
        (bytes(range(256)) * 10, ["a binary file, not a TOML file"]),
        (gzip.compress(b"title = 'x'\n"), ["an archive, not a TOML file"]),
        ("title = 'x'\n".encode("utf-16"), ["text in UTF-16, not a TOML file in UTF-8"]),
        ("title = 'Brücke'\n".encode("latin-1"), ["not a UTF-8 text file", "byte 11"]),
        (b"some words\n", ["not valid TOML", "line 1"]),
    ],
    ids=["empty", "blank", "binary", "archive", "utf-16", "latin-1", "text"],
)
def test_other_content_is_named(tmp_path, content, words):
    path = tmp_path / "mine.toml"
    path.write_bytes(content)
    refused(run(path), "mine.toml", *words)
    refused(replay(path), "mine.toml", *words)


@pytest.mark.parametrize(
    ("name", "content", "words"),
    [
        (
            "notes.md",
            "# Notes\n\nSome words.\n",
            ["text, not a TOML file; allowed is a .toml file", ".ulg"],
        ),
        ("a.nmea", "$GPGGA,123519,4807.038,N,01131.000,E,1,08,0.9,545.4,M,46.9,M,,*47\r\n" * 3, ["NMEA 0183", "recorded"]),
        (
            "a.gpx",
            '<?xml version="1.0"?>\n<!-- a ride -->\n<gpx version="1.1"><trk/></gpx>\n',
            ["a GPX file", "recorded"],
        ),
        (
            "a.kml",
            '\ufeff<kml xmlns="http://www.opengis.net/kml/2.2"></kml>',
            ["a KML file", "trajectories.md"],
        ),
        ("a.xml", "<settings>1</settings>", ["text, not a TOML file"]),
    ],
    ids=["markdown", "nmea", "gpx", "kml", "xml"],
)
def test_a_log_that_is_none_says_what_it_is_in_every_command(tmp_path, name, content, words):
    path = tmp_path / name
    path.write_text(content, encoding="utf-8")
    for answer in (replay(path), call("allan", path), call("tune", path, "-e", "loosely-coupled")):
        refused(answer, name, *words)
        assert "not valid TOML" not in answer[2]


def test_a_binary_file_may_be_a_flight_log_of_another_name(tmp_path):
    (tmp_path / "flight.log").write_bytes(bytes(range(256)) * 10)
    refused(replay(tmp_path / "flight.log"), "a binary file", ".tlog, .BIN, .ulg, .mcap, .db3 or .bag")


@pytest.mark.parametrize("name", ["flight.tlog", "flight.BIN", "flight.ulg"])
def test_an_empty_flight_log(tmp_path, name):
    (tmp_path / name).write_bytes(b"")
    refused(replay(tmp_path / name), name, "the file is empty")


def test_a_byte_order_mark_does_no_harm(tmp_path):
    (tmp_path / "marked.toml").write_bytes(b"\xef\xbb\xbf" + OWN.read_bytes())
    assert call("run", tmp_path / "marked.toml", "--duration", 5)[0] == 0
    for path in PLAIN.parent.glob("plain*"):
        (tmp_path / path.name).write_bytes(b"\xef\xbb\xbf" + path.read_bytes())
    assert call("replay", tmp_path / "plain.toml", "-e", "loosely-coupled")[0] == 0


def test_a_scenario_that_names_no_estimator(tmp_path):
    path = tmp_path / "mine.toml"
    path.write_text(OWN.read_text("utf-8").replace("estimators = ", "# estimators = "), encoding="utf-8")
    answer = run(path)
    refused(answer, "'mine' names no estimator", "-e ID", "estimators = [", "q-method")
    assert "loosely-coupled" not in answer[2]  # it needs GNSS
    refused(call("stream", path, "--to", "udpout:127.0.0.1:14550"), "names no estimator", "-e ID")


@pytest.mark.parametrize(
    "arguments",
    [
        ("run", "ship-swaying", "--out", ""),
        ("replay", "", "-e", "q-method"),
        ("replay", PLAIN, "-e", "loosely-coupled", "-o", ""),
        ("campaign", "ship-swaying", "-e", "q-method", "-n", "2", "--out", ""),
        ("reproduce", "--out", ""),
        ("train", "lssvm", "large-misalignment", "--out", ""),
        ("stream", "ship-swaying", "--to", "udpout:127.0.0.1:14550", "--tlog", ""),
        ("fmu", "export", "q-method", "--output", ""),
        ("fmu", "run", "x.fmu", "--input", ""),
        ("new", "scenario", ""),
        ("examples", ""),
    ],
    ids=lambda arguments: " ".join(map(str, arguments[:2])),
)
def test_an_empty_path_is_refused(arguments):
    refused(call(*arguments), "is empty: allowed is a path")
