"""`fusion` for a day without GNSS: a barometer holds the height within its own errors."""

import numpy as np
import pytest
from changed_scenario import changed

from insenv.geodesy import MEAN_RADIUS
from insenv.runs.ensemble import ensemble


def day():
    """The ship of `ship-dvl` without its log, with a barometer; GNSS is lost after ten minutes."""
    lost, barometer = {"outages_s": [[600.0, 90000.0]]}, {"grade": "ms5611", "interval_s": 1.0}
    return changed("ship-dvl", gnss=lost, dvl=None, barometer=barometer, duration_s=86400.0, rate_hz=20.0)


@pytest.mark.slow
def test_the_height_of_a_day_without_gnss_is_that_of_the_barometer():
    """Without it the height error grows by a factor of e every 9.5 minutes."""
    found = ensemble(day(), ["fusion"], range(20000, 20004), records=288)
    outputs, late = found.outputs["fusion"], found.time > 600.0
    error = (outputs["height"] - found.truth["height"])[:, late]
    sigma = outputs["position_sigma"][:, late, 2]
    # of the barometer: weather of 2.0 m, beside what GNSS of 2.5 m CEP and its wander left of its offset in ten minutes
    assert 2.0 < sigma.max() < 3.5
    rms = np.sqrt(np.mean(error**2))
    assert rms < 1.5 * np.sqrt(np.mean(sigma**2)) and np.mean(np.abs(error) > 3 * sigma) < 0.02
    assert np.abs(error).max() < 4.5 * sigma.max()
    # the preset estimates what drifts; 3.3 is the 99.9 % point of the mean square of its 4 x 2 drifts
    place = np.stack([outputs["latitude"] - found.truth["latitude"], outputs["longitude"] - found.truth["longitude"]], -1)
    place *= MEAN_RADIUS * np.stack([np.ones_like(found.truth["latitude"]), np.cos(found.truth["latitude"])], -1)
    assert np.mean((place / outputs["position_sigma"][:, :, :2])[:, late] ** 2) < 3.3
