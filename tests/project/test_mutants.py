"""The list of injected faults fits the sources: every text stands once, and there are enough."""

import mutants
import pytest
from places import ROOT


def test_every_fault_of_the_list_can_be_made():
    listed = mutants.listed()
    assert len(listed) >= 100 and len(set(listed)) == len(listed)
    for mutant in listed:
        for test in mutant.tests[:-2] if mutant.tests[-2:] == mutants.ALL else mutant.tests:
            path, _, name = test.partition("::")
            assert (ROOT / path).is_file(), test
            assert not name or f"def {name}(" in (ROOT / path).read_text(encoding="utf-8"), test


def test_a_text_that_does_not_stand_once_is_an_error(tmp_path, monkeypatch):
    faults = tmp_path / "faults.toml"
    monkeypatch.setattr(mutants, "LIST", faults)
    for text, said in (
        ("no such text", "stands 0 times"),
        ("import", "times in the file"),
        ("OMEGA_IE = 7.292115e-5", "no fault"),
    ):
        faults.write_text(f'[[file]]\npath = "insenv/geodesy/wgs84.py"\ntests = []\nmutants = [["{text}", "{text}"]]\n')
        with pytest.raises(SystemExit, match=said):
            mutants.listed()


def test_a_fault_is_made_in_a_copy_found_and_taken_back(tmp_path, monkeypatch):
    """One that a test finds, one that it cannot find, and one that is no program."""
    for folder in ("insenv", "tests"):
        (tmp_path / folder).mkdir()
    (tmp_path / "insenv" / "thing.py").write_text("def twice(x):\n    return 2 * x  # doubled\n")
    (tmp_path / "tests" / "test_thing.py").write_text(
        "import sys\nsys.path.insert(0, 'insenv')\nfrom thing import twice\n\ndef test_twice():\n    assert twice(3) == 6\n"
    )
    monkeypatch.setattr(mutants, "ROOT", tmp_path)
    monkeypatch.setattr(mutants, "TRAVELS", ("insenv", "tests"))
    tree = mutants.copied(tmp_path)
    said = {}
    for becomes in ("3 * x", "x + x", "2 * * x"):
        mutant = mutants.Mutant("insenv/thing.py", "2 * x", becomes, ("tests/test_thing.py",))
        outcome = mutants.tried(mutant, tree, 60.0)
        said[becomes] = outcome.said
        assert "2 * x  # doubled" in (tree / "insenv" / "thing.py").read_text()
    assert said == {"3 * x": "killed", "x + x": "survived", "2 * * x": "broken"}
    assert "2 * x" in (tmp_path / "insenv" / "thing.py").read_text()


def test_a_fault_killed_before_is_not_tried_again(tmp_path, monkeypatch):
    """What survived is tried again, and so is a fault whose text has changed."""
    (tmp_path / "thing.py").write_text("a = 1\nb = 2\nc = 3\n")
    monkeypatch.setattr(mutants, "ROOT", tmp_path)
    monkeypatch.setattr(mutants, "TRAVELS", ("thing.py",))
    monkeypatch.setattr(mutants, "sound", lambda *_: None)
    tried = []

    def tested(tree, tests, limit_s):
        tried.append((tree / "thing.py").read_text())
        return ("survived", "") if "b = 5" in tried[-1] else ("killed", "test_of_it")

    monkeypatch.setattr(mutants, "tested", tested)
    listed = [mutants.Mutant("thing.py", text, text[:-1] + "5", ()) for text in ("a = 1", "b = 2", "c = 3")]
    file = tmp_path / "outcomes.jsonl"
    said = [{o.mutant.text: o.said for o in mutants.all_tried(listed, 1, 60.0, file)} for _ in range(2)]
    assert said[0] == said[1] == {"a = 1": "killed", "b = 2": "survived", "c = 3": "killed"}
    assert len(tried) == 4 and tried[3] == tried[1]
    mutants.all_tried([mutants.Mutant("thing.py", "a = 1", "a = 7", ())], 1, 60.0, file)
    assert tried[4].startswith("a = 7")
