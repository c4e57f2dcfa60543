"""Jamming and spoofing of the streamed vehicle: its fixes, and the estimate that they mislead."""

from math import nan

import numpy as np
import pytest
from streamed_vehicle import ACCEPTED, DENIED, command, quiet, steps, texts

from insenv import geodesy


def fixes_and_errors(vehicle, seconds):
    """The fixes delivered in `seconds`, and the displacement of each from the undisturbed one (3, m, n)."""
    twin = quiet()
    steps(twin, vehicle.simulation.time)
    found = []
    for _ in range(round(seconds / vehicle.simulation.interval)):
        before = vehicle.simulation.fixes
        vehicle.step(), twin.step()
        if vehicle.simulation.fixes > before:
            fix, clean = vehicle.simulation.fix, twin.simulation.fix
            place = (clean.latitude, clean.longitude, clean.height)
            moved = np.ravel(geodesy.numeric.ned_offset(fix.latitude, fix.longitude, fix.height, *place))
            found.append((vehicle.simulation.time, moved, fix, clean))
    return found


def test_spoofing_and_drift_displace_the_fixes_and_mislead_the_estimate():
    vehicle = quiet()
    steps(vehicle, 10.5)
    assert command(vehicle, 31014, 2.0, 3.0, -4.0, 1.0)[0] == ACCEPTED and texts(vehicle)[-1] == "GNSS: spoofing"
    for _, moved, fix, clean in fixes_and_errors(vehicle, 5.0):
        np.testing.assert_allclose(moved, [3.0, -4.0, 1.0], atol=1e-3)
        np.testing.assert_array_equal(fix.position_sigma, clean.position_sigma)  # the receiver does not notice
    begun = vehicle.simulation.time
    assert command(vehicle, 31014, 3.0, 0.0, 0.5, 0.0)[0] == ACCEPTED
    for time, moved, fix, clean in fixes_and_errors(vehicle, 5.0):
        np.testing.assert_allclose(moved, [0.0, 0.5 * (time - begun), 0.0], atol=1e-3)
        np.testing.assert_allclose(fix.velocity_n - clean.velocity_n, [0.0, 0.5, 0.0], atol=1e-12)
    assert command(vehicle, 31014, 0.0)[0] == ACCEPTED and texts(vehicle)[-1] == "GNSS: undisturbed"
    assert all(not np.any(moved) for _, moved, _, _ in fixes_and_errors(vehicle, 3.0))


def test_jamming_loses_fixes_and_lost_satellites_make_them_worse():
    jammed = quiet()
    assert command(jammed, 31014, 1.0, 0.5)[0] == ACCEPTED
    steps(jammed, 100.0)
    assert 30 < jammed.simulation.fixes < 70
    command(jammed, 31014, 1.0, 1.0)
    before = jammed.simulation.fixes
    steps(jammed, 5.0)
    assert jammed.simulation.fixes == before and not jammed.view.has_lock
    again = quiet()
    command(again, 31014, 1.0, 0.5)
    steps(again, 100.0)
    assert again.simulation.fixes == before  # a function of seed and fix number
    few = quiet()
    assert command(few, 31014, 4.0, 10.0)[0] == ACCEPTED
    found = fixes_and_errors(few, 60.0)
    for _, _, fix, clean in found:
        np.testing.assert_allclose(fix.position_sigma, 10.0 * clean.position_sigma)
    scaled = np.array([moved / (np.sqrt(99.0) * clean.position_sigma) for _, moved, _, clean in found])
    assert 0.8 < np.std(scaled) < 1.2 and len(found) >= 58


@pytest.mark.parametrize("values", [(5.0,), (0.5,), (nan,), (1.0, 1.5), (1.0, nan), (2.0, 1e9), (4.0, 0.5), (3.0, 1.0, nan)])
def test_wrong_interference_is_refused(values):
    vehicle = quiet()
    assert command(vehicle, 31014, *values)[0] == DENIED and vehicle.simulation.interference is None
    assert "allowed is" in texts(vehicle)[-1]
    assert command(quiet("ship-swaying"), 31014, 1.0, 1.0)[0] == DENIED
