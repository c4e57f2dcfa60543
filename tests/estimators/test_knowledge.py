"""What is known at the start: stated errors by row, and the former fields of a receiver."""

import copy
import pickle
import re
from dataclasses import replace

import numpy as np
import pytest

from insenv.base.errors import InputError
from insenv.estimators.knowledge import Knowledge

KNOWN = Knowledge(0.8, 0.1, 100.0, 0.005)


def test_the_way_that_a_former_field_names_works_without_a_receiver():
    with pytest.warns(FutureWarning, match=re.escape("is now Knowledge.instruments['antenna_lever_arm']")):
        assert np.array_equal(KNOWN.antenna_lever_arm, np.zeros(3))
    for known in (KNOWN, replace(KNOWN, height=3.0), copy.deepcopy(KNOWN), pickle.loads(pickle.dumps(KNOWN))):
        assert np.array_equal(known.instruments["antenna_lever_arm"], np.zeros(3)) and not known.instruments
        assert known.instruments["fix_wander_time"] > 0.0 and "antenna_lever_arm" not in known.rows
    assert replace(KNOWN, instruments={"fix_wander_time": 5.0}).instruments["fix_wander_time"] == 5.0
    with pytest.raises(InputError, match="no row named 'antena_lever_arm'; did you mean 'antenna_lever_arm'"):
        KNOWN.instruments["antena_lever_arm"]


def test_setting_a_former_field_names_the_new_way():
    allowed = "allowed is Knowledge(instruments={'antenna_lever_arm': ...})"
    with pytest.raises(TypeError, match=re.escape(allowed)):
        Knowledge(0.8, 0.1, 100.0, 0.005, antenna_lever_arm=[1.0, 0.0, 0.0])
