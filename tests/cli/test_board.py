"""`insenv export c`."""

from command_line import call, strict


def test_it_writes_the_filter_with_the_settings_of_the_command_line(tmp_path):
    changed = ["--set", "q-method.smoothing_time_s=3.5", "--name", "aligner", "--no-figures"]
    status, out, _ = call("export", "c", "q-method", "ship-swaying", "-o", tmp_path, *changed)
    assert status == 0
    assert out.startswith(f"{tmp_path}: aligner.h and aligner.c, with the inputs and outputs of 300 samples\n")
    assert "  3.5, /* smoothing_time */\n" in (tmp_path / "aligner.c").read_text()
    status, out, _ = call("export", "c", "q-method", "-o", tmp_path, "--no-figures", "--whole-run", "--duration", 9, "--json")
    told = strict(out)
    assert (status, told["name"], told["samples"], told["run_samples"], told["figures"]) == (0, "q_method", 300, 1800, None)
    assert all((tmp_path / name).is_file() for name in told["files"])


def test_it_says_what_single_precision_costs(tmp_path):
    mixed = ["--precision", "mixed", "--duration", 9, "--no-figures"]
    status, out, _ = call("export", "c", "loosely-coupled", "car-city-drive", "-o", tmp_path, *mixed)
    assert status == 0
    assert out.splitlines()[-1].startswith("mixed: outputs differ from those in double precision by up to ")
