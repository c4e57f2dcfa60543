"""The exported filter, compiled for this machine: bit-identical to `insenv run` and `insenv replay`."""

import subprocess

import numpy as np
import pytest
from changed_scenario import car_of_any_heading
from peers import program, ran
from simulated_log import simulated_log

import insenv
from insenv.base.errors import InputError
from insenv.export.board import export_c
from insenv.scenario import build, load

SHORT = {"duration_s": 16.0, "whole_run": True, "measure": False}


def make(folder, *arguments):
    """Run `make`; give the lines that it prints last, and whether it succeeded."""
    command = [program("make", how="apt-get install make"), "-s", "-C", str(folder), "CFLAGS=-O0 -Wall -Wextra", *arguments]
    done = subprocess.run(command, capture_output=True, text=True)
    return done.stdout.splitlines(), done.returncode == 0


def last_outputs(exported, model):
    """The outputs that the test expects at the end of the whole run, by name."""
    text = (exported.folder / "test" / "run.bin").read_bytes()[-8 * model.outputs.size :]
    return model.outputs.unpack(np.frombuffer(text))


@pytest.mark.parametrize(("id", "scenario"), [("q-method", "ship-swaying"), ("loosely-coupled", "car-city-drive")])
def test_a_filter_compiled_here_has_the_bits_of_insenv_run(tmp_path, id, scenario):
    same_bits_as_run(tmp_path, id, scenario, 16.0)


@pytest.mark.slow
def test_a_heading_found_among_every_one_is_handed_over_with_the_bits_of_insenv_run(tmp_path):
    result = same_bits_as_run(tmp_path, "fusion", car_of_any_heading(), 50.0)
    assert any("heading found" in note for note in result.notes)
    assert "alignment_level" in (tmp_path / "out" / "fusion.c").read_text()


def same_bits_as_run(tmp_path, id, scenario, duration_s):
    """The result of a run, whose outputs a filter compiled here has."""
    exported = export_c(id, scenario, output=tmp_path / "out", seed=3, **{**SHORT, "duration_s": duration_s})
    lines, good = make(exported.folder, "check", "RUN=test/run.bin")
    assert good, lines
    assert lines[1].startswith(f"test/run.bin: {exported.run_samples} samples, ")
    assert lines[1].endswith(", 0 differ")
    (result,) = insenv.run(scenario, id, seed=3, duration_s=duration_s).results
    for name, value in last_outputs(exported, build(load(scenario)).adapted(id).model).items():
        assert value.tobytes() == result.outputs[name][-1].tobytes(), name
    return result


def test_a_filter_of_a_log_has_the_bits_of_insenv_replay(tmp_path):
    log, how = simulated_log("car-city-drive", duration_s=10.0), {"start": "reference"}
    how["settings"] = {"loosely-coupled": {"arw_deg_sqrt_h": 0.3}}
    exported = export_c("loosely-coupled", log, output=tmp_path / "out", name="of_log", whole_run=True, measure=False, **how)
    assert make(exported.folder, "RUN=test/run.bin")[1]
    (result,) = insenv.replay(log, "loosely-coupled", **how).results
    values = last_outputs(exported, insenv.estimators.get("loosely-coupled").model)
    assert all(value.tobytes() == result.outputs[name][-1].tobytes() for name, value in values.items())


def test_the_test_on_the_board_finds_another_bit(tmp_path):
    folder = export_c("q-method", output=tmp_path, name="q", measure=False).folder
    samples = folder / "test" / "samples.h"
    head, _, rest = samples.read_text().partition("first_outputs[SAMPLES / EVERY][8] = {\n  {")
    number, _, rest = rest.partition(",")
    changed = repr(float(np.nextafter(float(number), 2.0)))
    samples.write_text(f"{head}first_outputs[SAMPLES / EVERY][8] = {{\n  {{{changed},{rest}")
    lines, good = make(folder)
    assert not good
    assert lines == [
        f"value 0 after 10 samples: {float(number):.17g}, expected {float(changed):.17g}",
        "samples.h: 300 samples, 248 numbers compared, 1 differ",
        "NOT the same bits",
    ]


def test_a_run_that_was_cut_off_is_not_the_same(tmp_path):
    """A record has the inputs of some samples and the outputs after them: whole records alone are a run."""
    exported = export_c("q-method", output=tmp_path, duration_s=0.2, whole_run=True, measure=False)
    samples, run = tmp_path / "test" / "samples.h", tmp_path / "test" / "run.bin"
    text = samples.read_text()
    assert "#define RUN_EVERY 1 " in text
    samples.write_text(text.replace("#define RUN_EVERY 1 ", "#define RUN_EVERY 4 "))
    size = insenv.estimators.get("q-method").model.inputs.size
    rows = np.frombuffer(run.read_bytes()).reshape(exported.run_samples, -1)
    records = [np.concatenate([rows[k : k + 4, :size].ravel(), rows[k + 3, size:]]) for k in range(0, 8, 4)]
    whole, one = np.concatenate(records).tobytes(), records[0].nbytes
    cut = [one + 8, one + 3 * 8 * size, 2 * one - 8, 0]
    for length, same in ((2 * one, True), (one, True), *((length, False) for length in cut)):
        run.write_bytes(whole[:length])
        lines, good = make(exported.folder, "check", "RUN=test/run.bin")
        assert good == same and lines[-1] == ("same bits" if same else "NOT the same bits"), (length, lines)


@pytest.mark.slow
def test_the_largest_filter_is_clean_as_c_and_as_c_plus_plus(tmp_path):
    """The arrays of a function are of one type: that they could be swapped is what clang-tidy is not asked."""
    export_c("fusion", output=tmp_path, measure=False)
    checks = "-*,bugprone-*,-bugprone-easily-swappable-parameters,cert-*,clang-analyzer-*,performance-*,portability-*"
    tidy = program("clang-tidy", how="apt-get install clang-tidy")
    ran(tidy, f"--checks={checks}", "--warnings-as-errors=*", "--quiet", "fusion.c", "--", "-std=c99", cwd=tmp_path)
    flags = ["-Wall", "-Wextra", "-Wconversion", "-Wshadow", "-pedantic", "-Werror"]
    ran(program("g++", how="apt-get install g++"), "-x", "c++", "-std=c++11", *flags, "-c", "fusion.c", cwd=tmp_path)


def test_an_export_replaces_an_earlier_one_and_its_run(tmp_path):
    export_c("q-method", output=tmp_path, **SHORT)
    again = export_c("q-method", output=tmp_path, measure=False)
    here = {str(path.relative_to(tmp_path)) for path in tmp_path.rglob("*") if path.is_file()}
    assert here == set(again.files)


def test_files_that_are_not_of_an_export_are_not_replaced(tmp_path):
    (tmp_path / "Makefile").write_text("mine")
    with pytest.raises(InputError, match=r"' has Makefile and is no earlier export: allowed is a folder without such files"):
        export_c("q-method", output=tmp_path, measure=False)
    with pytest.raises(InputError, match=r"Makefile' is a file: allowed is a folder"):
        export_c("q-method", output=tmp_path / "Makefile", measure=False)
    assert [(path.name, path.read_text()) for path in tmp_path.iterdir()] == [("Makefile", "mine")]


def test_a_run_gives_whole_rows_of_ten_samples(tmp_path):
    with pytest.raises(InputError, match="the run has 9 samples: allowed are 10 or more"):
        export_c("q-method", output=tmp_path, duration_s=0.045, measure=False)
    exported = export_c("q-method", output=tmp_path, duration_s=0.06, measure=False)
    assert exported.samples == 10 and "#define SAMPLES 10\n" in (tmp_path / "test" / "samples.h").read_text()


def test_a_log_has_its_own_seed_and_duration(tmp_path):
    with pytest.raises(InputError, match="seed = 3: allowed with a scenario"):
        export_c("loosely-coupled", simulated_log("car-city-drive", duration_s=10.0), output=tmp_path, seed=3)
