"""The list of injected faults fits the sources: every text stands once, and there are enough."""

import mutants
from places import ROOT


def test_every_fault_of_the_list_can_be_made():
    listed = mutants.listed()
    assert len(listed) >= 100 and len(set(listed)) == len(listed)
    for mutant in listed:
        for test in mutant.tests:
            path, _, name = test.partition("::")
            assert (ROOT / path).is_file(), test
            assert not name or f"def {name}(" in (ROOT / path).read_text(encoding="utf-8"), test


def test_a_fault_is_made_in_a_copy_found_and_taken_back(tmp_path, monkeypatch):
    source, test = tmp_path / "insenv" / "thing.py", tmp_path / "tests" / "test_thing.py"
    for path, text in (
        (source, "def twice(x):\n    return 2 * x\n"),
        (test, "import sys\nsys.path.insert(0, 'insenv')\nfrom thing import twice\ndef test_it():\n    assert twice(3) == 6\n"),
    ):
        path.parent.mkdir()
        path.write_text(text)
    monkeypatch.setattr(mutants, "ROOT", tmp_path)
    monkeypatch.setattr(mutants, "TRAVELS", ("insenv", "tests"))
    tree = mutants.copied(tmp_path)
    for becomes, said in (("3 * x", "killed"), ("x + x", "survived"), ("2 * * x", "broken")):
        mutant = mutants.Mutant("insenv/thing.py", "2 * x", becomes, ("tests/test_thing.py",))
        assert mutants.tried(mutant, tree, 60.0).said == said
        assert (tree / "insenv" / "thing.py").read_text() == source.read_text()
