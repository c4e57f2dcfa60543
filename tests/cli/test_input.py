"""Wrong input at the command line ends in one clear line and exit status 2."""

import pytest
from command_line import ROOT, call, log_file, refused


@pytest.fixture
def scenario_file(tmp_path):
    """Write ship-swaying with one text replaced; return the path."""

    def write(old="", new=""):
        text = (ROOT / "scenarios" / "ship-swaying.toml").read_text("utf-8")
        assert old in text
        path = tmp_path / "mine.toml"
        path.write_text(text.replace(old, new, 1), encoding="utf-8")
        return path

    return write


# --- wrong input -------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["run", "ship-swayin"], ["ship-swayin", "did you mean 'ship-swaying'"]),
        (["run", "missing/file.toml"], ["missing/file.toml"]),
        (["run", "ship-swaying", "-e", "q-methd"], ["q-methd", "did you mean 'q-method'"]),
        (["run", "ship-swaying", "-e", "loosely-coupled"], ["loosely-coupled", "GNSS"]),
        (["run", "ship-swaying", "--duration", "0"], ["duration_s", "0", " s"]),
        (["run", "ship-swaying", "--duration", "1e9"], ["duration_s", "1e+09", " s"]),
        (["run", "ship-swaying", "--duration", "nan"], ["duration_s", "nan"]),
        (["run", "ship-swaying", "--duration", "-5"], ["duration_s", "-5"]),
        (["run", "ship-swaying", "--duration", "long"], ["allowed is a number", "--duration"]),
        (["run", "ship-swaying", "--seed", "-1"], ["seed", "-1"]),
        (["run", "ship-swaying", "--sed", "1"], ["--sed", "--help"]),
        (["run", "ship-swaying", "--log", "d1"], ["'d1' after --log, which takes no value: With --out: write", "as a log"]),
        (["run", "ship-swaying", "more"], ["'more' is an argument too many: allowed is insenv run [OPTIONS]", "SCENARIO"]),
        (["run"], ["SCENARIO"]),
        (["rum"], ["rum", "'run'"]),
        (["replay", "no.toml"], ["-e ID"]),
        (["replay", "no.toml", "-e", "loosely-coupled"], ["no.toml"]),
        (["replay", "no.toml", "-e", "loosly-coupled"], ["did you mean 'loosely-coupled'"]),
        (["replay", "no.toml", "-e", "loosely-coupled", "--start", "warm"], ["warm", "coarse", "reference"]),
    ],
    ids=lambda value: " ".join(value[:5]) if isinstance(value, list) else None,
)
def test_wrong_calls(arguments, words):
    refused(call(*arguments), *words)


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("latitude_deg = 30.0", "latitude_deg = 95.0", ["latitude_deg", "95", "deg", "89.999"]),
        ("duration_s = 300.0", "duration_s = 0", ["duration_s", "0"]),
        ("duration_s = 300.0", "duration_s = 1e9", ["duration_s", "1000000000", "86400"]),
        ('grade = "marine"', 'grade = "marine"\ngyro_arw_deg_sqrt_h = -0.1', ["gyro_arw_deg_sqrt_h", "-0.1"]),
        ('grade = "marine"', 'grade = "marin"', ["marin", "did you mean 'marine'"]),
        ("seed = 1", "sed = 1", ["sed", "seed"]),
        ("seed = 1", "seed = = 1", ["mine.toml", "line"]),
    ],
    ids=lambda value: value if isinstance(value, str) else None,
)
def test_wrong_scenarios(scenario_file, old, new, words):
    refused(call("run", scenario_file(old, new)), "mine.toml", *words)


def row(text, number, new):
    """Change line `number` of a text (0: the header) with the function `new`."""
    lines = text.splitlines(keepends=True)
    return "".join([*lines[:number], new(lines[number]), *lines[number + 1 :]])


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"imu": lambda t: row(t, 100, lambda r: r.replace("-6.0000", "nan"))}, ["plain-imu.csv", "nan"]),
        ({"imu": lambda t: row(t, 100, lambda r: "0.5," + r.split(",", 1)[1])}, ["plain-imu.csv", "time"]),
        ({"imu": lambda t: t[:-12]}, ["plain-imu.csv"]),
        ({"imu": lambda t: ""}, ["plain-imu.csv", "empty"]),
        ({"imu": lambda t: t.splitlines()[0] + "\n"}, ["plain-imu.csv"]),
        ({"imu": lambda t: t.replace("gyro_z", "gyro_q")}, ["plain-imu.csv", "gyro_z"]),
        ({"imu": lambda t: "".join(t.splitlines(keepends=True)[:100] + t.splitlines(keepends=True)[200:])}, ["gap", "0.2"]),
        ({"gnss": lambda t: row(t, 5, lambda r: r.replace(",0.5,", ",0,", 1))}, ["plain-gnss.csv", "std_n"]),
        ({"toml": lambda t: t.replace('"plain-imu.csv"', '"gone.csv"')}, ["gone.csv"]),
        ({"toml": lambda t: t.replace("title", "titel")}, ["titel", "title"]),
        ({"toml": lambda t: t.replace("[imu]", "[imu")}, ["plain.toml", "line"]),
    ],
    ids=[
        "nan",
        "backwards",
        "truncated",
        "empty",
        "header-only",
        "no-column",
        "gap",
        "sigma-0",
        "no-file",
        "unknown-key",
        "no-toml",
    ],
)
def test_wrong_logs(tmp_path, changes, words):
    refused(call("replay", log_file(tmp_path, **changes), "-e", "q-method"), *words)
