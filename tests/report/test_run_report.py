"""A report in Python and in a notebook."""

import re
import sys

import numpy as np
import pytest
from made_up_reports import PLACE, TIME, of_health, report, result

from insenv.errors import InputError, InsenvError
from insenv.evaluation.errors import ATTITUDE


def test_repr_is_short():
    text = repr(report(result(), result("q-method", ATTITUDE))).splitlines()
    assert text[0] == "Report of made-up, seed 7, 100 s, 20000 inertial samples" and len(text) == 3
    assert re.fullmatch(r"  loosely-coupled: final error heading \S+ deg, position \S+ m", text[1])
    assert repr(result(errors={})) == "loosely-coupled: no reference"


def test_html_holds_the_tables_and_the_figure(monkeypatch):
    made = report(of_health(ratio=3.0), result("mine", errors={}), notes=("a < b",))
    text = made._repr_html_()
    assert text.count("<table>") == 2 and "heading [deg]" in text and "a &lt; b" in text and "latitude [deg]" in text
    assert 'src="data:image/png;base64,' in text and "overconfident" in text
    monkeypatch.setitem(sys.modules, "matplotlib", None)
    assert "<img" not in made._repr_html_() and "<table>" in made._repr_html_()
    with pytest.raises(InputError, match=r"matplotlib, which is not installed: pip install"):
        made.plot()


def test_what_is_not_there_is_not_plotted():
    assert len(report(result("q-method", ATTITUDE)).plot().axes) == 6
    with pytest.raises(InsenvError, match="neither a reference"):
        report(result(errors={}, outputs={})).plot()


def test_dataframe(monkeypatch):
    made = report(result(), result("q-method", ATTITUDE))
    frame = made.to_dataframe("loosely-coupled")
    assert frame.index.name == "time" and np.array_equal(frame.index, TIME)
    assert np.array_equal(frame["error_north_m"], made.results[0].errors["north_m"])
    assert np.array_equal(frame["sigma_vn_mps"], made.results[0].sigma["vn_mps"])
    assert np.array_equal(frame[[f"q_nb_{i}" for i in range(4)]], made.results[0].outputs["q_nb"])
    assert np.array_equal(report().to_dataframe()["latitude"], PLACE["latitude"])
    with pytest.raises(InputError, match="must be named, this run has loosely-coupled, q-method"):
        made.to_dataframe()
    with pytest.raises(InputError, match="did you mean 'q-method'"):
        made.to_dataframe("q-methd")
    monkeypatch.setitem(sys.modules, "pandas", None)
    with pytest.raises(InsenvError, match="pip install pandas"):
        made.to_dataframe("q-method")
