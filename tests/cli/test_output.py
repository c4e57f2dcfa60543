"""What is shown: compilations once, tables as wide as the terminal."""

import logging
import re
from threading import Thread

from command_line import ROOT, SHORT, call

import insenv
from insenv.cli.output import compiling_noticed, print_blocks, speaking
from insenv.core.compile import COMPILED, COMPILING, LOG
from insenv.report.document import Grid


def test_a_compilation_is_said_once_though_a_package_has_given_the_root_logger_a_handler(capsys, caplog):
    with compiling_noticed():
        for text in (COMPILING, COMPILED, COMPILING):
            LOG.info(text)
    assert capsys.readouterr().err == "insenv: compiling, once\n" and not caplog.messages
    assert LOG.propagate and not LOG.isEnabledFor(logging.DEBUG)


def test_tables_are_not_cut_at_a_narrow_terminal(capsys, monkeypatch):
    cell = "walk 25.2 [19.4, 31.5] deg/h/sqrt(h), " * 4
    print_blocks([Grid(("first", "second"), [("a b", cell)])])
    assert cell.strip() in capsys.readouterr().out
    monkeypatch.setenv("FORCE_COLOR", "1")  # a terminal, to rich
    monkeypatch.setenv("COLUMNS", "50")
    status, out, _ = call("run", "car-city-drive", "--duration", "5", "-e", "wander-sins")
    lines = [re.sub(r"\x1b\[[0-9;?]*[a-zA-Z]", "", line).rstrip() for line in out.splitlines()]
    row = next(line for line in lines if line.startswith("heading [deg]"))
    assert status == 0 and "…" not in row and len(row.split()) >= 6  # no digit is cut off
    assert max(len(line) for line in lines if line.startswith(("final", "time", "note"))) <= 50


def test_quiet_and_verbose(capsys):
    """Nothing but errors, or every step as a line; what is compiled in other threads too."""
    for level, said in ((-1, []), (0, [COMPILING]), (1, [COMPILING, COMPILED, COMPILING])):
        with compiling_noticed(), speaking(level):
            for text in (COMPILING, COMPILED, COMPILING):
                thread = Thread(target=LOG.info, args=(text,))
                thread.start()
                thread.join()
        assert capsys.readouterr().err.splitlines() == [f"insenv: {text}" for text in said]
    assert "insenv: ship-swaying: 100 %" in call(*SHORT, "-v")[2].splitlines() and call(*SHORT, "-q")[2] == ""


def test_reproduce_says_without_a_terminal_what_is_measured(monkeypatch):
    monkeypatch.setattr("insenv.reproduce.reproduce", lambda paper: iter([("ecef", []), ("swaying", [])]))
    assert call("reproduce")[::2] == (0, "insenv: measured ecef\ninsenv: measured swaying\n")
    assert call("reproduce", "--quiet")[2] == ""


def test_former_names_of_options_work_with_a_note(tmp_path):
    given = ("allan", ROOT / "examples" / "logs" / "plain.toml", "--from", "0", "--to", "25")
    said = "insenv: note: --grade is now --grade-out; the former name still works\n"
    assert call(*given, "--grade", tmp_path / "a.toml")[::2] == (0, said)
    assert "gyro_arw_deg_sqrt_h" in (tmp_path / "a.toml").read_text()
    for out in ("--out", "--output", "-o"):
        assert call("run", "ship-swaying", "--duration", 1, "--no-figure", out, tmp_path / "x")[0] == 0


def test_a_shell_completes_commands_scenarios_and_estimators(monkeypatch):
    offers = {"insenv re": "replay", "insenv run ship-s": "ship-swaying", "insenv run x -e lo": "loosely-coupled"}
    monkeypatch.setenv("_INSENV_COMPLETE", "complete_bash")
    for line, offered in offers.items():
        monkeypatch.setenv("COMP_WORDS", line)
        monkeypatch.setenv("COMP_CWORD", str(line.count(" ")))
        assert offered in call()[1].split()


def test_a_printed_result_is_the_table_of_the_command():
    texts = str(insenv.run("ship-swaying", duration_s=10.0)), call(*SHORT)[1]
    shown, printed = (re.sub(r"[0-9.e-]+ us a sample", "", text) for text in texts)
    assert "heading [deg]" in shown and printed.startswith(shown)
