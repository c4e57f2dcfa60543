"""A report in Python and in a notebook."""

import sys

import numpy as np
import pytest
from made_up_reports import PLACE, TIME, of_health, report, result

from insenv.base.errors import InputError, InsenvError
from insenv.base.remarks import coded
from insenv.evaluation.errors import ATTITUDE


def test_html_is_escaped_and_holds_the_figure():
    made = report(of_health(ratio=3.0), result("mine", errors={}), notes=coded(["a < b"], "note"))
    text = made._repr_html_()
    assert "a &lt; b" in text
    assert 'src="data:image/png;base64,' in text


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
    monkeypatch.setitem(sys.modules, "pandas", None)
    with pytest.raises(InsenvError, match="pip install pandas"):
        made.to_dataframe("q-method")
