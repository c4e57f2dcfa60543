"""Jamming and spoofing of the streamed vehicle: its fixes, and the estimate that they mislead."""

from math import nan

import numpy as np
from streamed_vehicle import ACCEPTED, DENIED, command, quiet, steps, texts

from insenv import geodesy


def fixes_and_errors(vehicle, twin, seconds):
    """The fixes delivered in `seconds` to a vehicle and to an undisturbed twin, and how far they are apart (3, m, n)."""
    for _ in range(round(seconds / vehicle.simulation.interval)):
        before = vehicle.simulation.fixes
        vehicle.step(), twin.step()
        if vehicle.simulation.fixes > before:
            fix, clean = vehicle.simulation.fix, twin.simulation.fix
            place = (clean.latitude, clean.longitude, clean.height)
            moved = np.ravel(geodesy.numeric.ned_offset(fix.latitude, fix.longitude, fix.height, *place))
            yield vehicle.simulation.time, moved, fix, clean


def test_spoofing_and_drift_displace_the_fixes():
    vehicle, twin = quiet(hz=20), quiet(hz=20)
    steps(vehicle, 10.5), steps(twin, 10.5)
    assert command(vehicle, 31014, 2.0, 3.0, -4.0, 1.0)[0] == ACCEPTED and texts(vehicle)[-1] == "GNSS: spoofing"
    for _, moved, fix, clean in fixes_and_errors(vehicle, twin, 5.0):
        np.testing.assert_allclose(moved, [3.0, -4.0, 1.0], atol=1e-3)
        np.testing.assert_array_equal(fix.position_sigma, clean.position_sigma)  # the receiver does not notice
    begun = vehicle.simulation.time
    assert command(vehicle, 31014, 3.0, 0.0, 0.5, 0.0)[0] == ACCEPTED
    for time, moved, fix, clean in fixes_and_errors(vehicle, twin, 5.0):
        np.testing.assert_allclose(moved, [0.0, 0.5 * (time - begun), 0.0], atol=1e-3)
        np.testing.assert_allclose(fix.velocity_n - clean.velocity_n, [0.0, 0.5, 0.0], atol=1e-12)
    assert vehicle.simulation.fixes == 20
    assert command(vehicle, 31014, 0.0)[0] == ACCEPTED and texts(vehicle)[-1] == "GNSS: undisturbed"
    assert [np.any(moved) for _, moved, _, _ in fixes_and_errors(vehicle, twin, 3.0)] == [False] * 3


def test_jamming_loses_fixes_and_lost_satellites_make_them_worse():
    jammed, again, few = (quiet(hz=20) for _ in range(3))
    for vehicle in (jammed, again):
        assert command(vehicle, 31014, 1.0, 0.5)[0] == ACCEPTED
        steps(vehicle, 100.0)
    assert 30 < jammed.simulation.fixes < 70
    before = again.simulation.fixes
    assert jammed.simulation.fixes == before  # a function of seed and fix number
    command(jammed, 31014, 1.0, 1.0)
    steps(jammed, 5.0)
    assert jammed.simulation.fixes == before and not jammed.view.has_lock
    assert command(few, 31014, 4.0, 10.0)[0] == ACCEPTED
    found = list(fixes_and_errors(few, quiet(hz=20), 60.0))
    for _, _, fix, clean in found:
        np.testing.assert_allclose(fix.position_sigma, 10.0 * clean.position_sigma)
    scaled = np.array([moved / (np.sqrt(99.0) * clean.position_sigma) for _, moved, _, clean in found])
    assert 0.8 < np.std(scaled) < 1.2 and len(found) >= 58


def test_wrong_interference_is_refused():
    vehicle = quiet()
    for values in ((5.0,), (1.0, 1.5), (2.0, 1e9), (4.0, 0.5), (3.0, 1.0, nan)):
        assert command(vehicle, 31014, *values)[0] == DENIED and vehicle.simulation.interference is None, values
        assert "allowed is" in texts(vehicle)[-1]
    assert command(quiet("ship-swaying"), 31014, 1.0, 1.0)[0] == DENIED
