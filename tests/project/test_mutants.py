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
