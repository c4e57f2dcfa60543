"""A filter in single precision, or with its covariance in it: what that costs, and the same bits wherever its C is compiled."""

from types import SimpleNamespace

import numpy as np
import pytest
from peers import program, ran

import insenv
from insenv.base.errors import InputError
from insenv.estimators.fusion.available import composition
from insenv.export.board import export_c
from insenv.export.board.precision import Compiled, checked, largest_shares, single_elements


@pytest.mark.parametrize(("precision", "kept"), [("mixed", 120), ("float32", 365)])
def test_a_filter_is_near_the_double_one_and_its_own_test_holds(tmp_path, precision, kept):
    """Of the 426 numbers of the state, float32 leaves 61 in double precision."""
    exported = export_c("loosely-coupled", output=tmp_path, duration_s=16.0, precision=precision, measure=False, whole_run=True)
    assert 0.0 < max(exported.shares.values()) < 0.002
    assert min(exported.shares.values()) >= 0.0
    assert {"heading_deg", "down_m", "vn_mps", "accel_bias"} < set(exported.shares)
    flags = "CFLAGS=-O1 -Wall -Wextra -Wconversion -Wshadow -pedantic -Werror"
    told = ran(program("make", how="apt-get install make"), "-s", "-C", tmp_path, flags, "RUN=test/run.bin")
    assert told.count(", 0 differ") == 2
    assert f"  float xf[{kept}]; /* state in single precision */" in (tmp_path / "loosely_coupled.h").read_text()
    assert f"{precision}: outputs differ from those in double precision by up to " in (tmp_path / "README.md").read_text()


def test_the_share_is_the_largest_difference_over_the_sigma_of_its_channel():
    model = insenv.estimators.get("loosely-coupled").model
    row = {"position_sigma": 2.0, "velocity_sigma": 0.5, "attitude_sigma": 0.1, "q_nb": [1.0, 0.0, 0.0, 0.0]}
    row |= {"accel_bias_estimate_sigma": 0.25, "gyro_bias_estimate_sigma": 1.0}
    one = np.tile(model.outputs.pack({**dict.fromkeys(model.outputs.names, 0.0), **row}), (3, 1))
    other = one.copy()
    other[1, model.outputs.slice("height")] = -1.0
    other[2, model.outputs.slice("accel_bias").start + 1] = -0.05
    shares = largest_shares(model, other, one)
    assert shares == {**dict.fromkeys(shares, 0.0), "down_m": pytest.approx(0.5), "accel_bias": 0.2}
    one[:, model.outputs.slice("position_sigma")] = 0.0
    assert largest_shares(model, one, one) == dict.fromkeys(shares, 0.0)
    other[1, model.outputs.slice("height")] = np.nan
    with pytest.raises(InputError, match=r"by up to nan of their stated sigma"):
        checked(largest_shares(model, other, one) | {"heading_deg": 0.01})


def test_scale_factors_and_biases_of_accelerometers_keep_the_digits_of_their_sum():
    """The covariance of these six states, 21 numbers; that of the biases alone needs no double precision."""
    both = composition("f", ("accel_scale",), ("gnss",)).model
    assert single_elements("mixed", both).count(True) == 18 * 19 / 2 - 21
    assert single_elements("mixed", composition("f", (), ("gnss",)).model).count(True) == 15 * 16 / 2


@pytest.mark.slow
def test_a_filter_that_single_precision_changes_too_much_is_refused_and_nothing_is_written(tmp_path):
    """Centimetre fixes and a unit of 0.1 deg/h: the sum of tilt and accelerometer bias is known far better than either."""
    with pytest.raises(InputError, match=r"precision: outputs differ .* by up to 0\.\d+ of .*; allowed is 0.05: export"):
        export_c("loosely-coupled", "aircraft-survey", output=tmp_path / "none", precision="mixed", duration_s=120.0)
    assert not (tmp_path / "none").exists()


@pytest.mark.slow
def test_a_correction_that_keeps_a_sum_leaves_the_position_in_double_precision(tmp_path):
    """The covariance, in single precision, comes from the corrected state there: of position it would be 10 stated sigmas."""
    exported = export_c("fusion", "multirotor-hover", output=tmp_path, duration_s=30.0, precision="float32", measure=False)
    assert max(exported.shares[name] for name in ("north_m", "east_m", "down_m")) < 1e-3


def test_a_filter_that_ends_with_a_status_is_refused():
    ended = SimpleNamespace(_model=SimpleNamespace(id="f"))
    with pytest.raises(InputError, match="precision: f ends with status 5 in it: export this filter in double precision"):
        Compiled._judge(ended, 5)


def test_a_filter_without_a_covariance_an_unknown_precision_and_a_missing_compiler_are_refused(tmp_path, monkeypatch):
    with pytest.raises(InputError, match="'mixed': q-method keeps no covariance; allowed is a filter"):
        export_c("q-method", output=tmp_path, precision="mixed")
    with pytest.raises(InputError, match="precision = 'half': allowed is 'double', 'mixed', 'float32'"):
        export_c("loosely-coupled", output=tmp_path, precision="half")
    monkeypatch.setattr("insenv.export.board.precision.find_compiler", lambda: None)
    with pytest.raises(InputError, match="another than 'double' needs a C compiler on this machine"):
        export_c("loosely-coupled", output=tmp_path, precision="mixed", duration_s=5.0)
