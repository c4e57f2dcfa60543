"""The limit beside a campaign where keys vary: those of some runs (else it is that of a run: test_campaign.py)."""

import numpy as np
import pytest
from campaigns import slow_ship

from insenv.scenario import limit_of
from insenv.studies.campaign import make_plan, parse_variation, run_campaign


def test_the_limit_follows_what_is_varied(monkeypatch):
    """Each run has the limit of its own scenario; of many runs, some have, and this is said."""
    monkeypatch.setattr("insenv.studies.campaign.summary.VARIED_RUNS", 3)
    variations = [parse_variation("start.latitude_deg=20:85"), parse_variation("imu.gyro_arw_deg_sqrt_h=0.001:0.01")]
    plan = make_plan(slow_ship(), "analytic", 3, first_seed=1, duration_s=20.0, variations=variations)
    found = run_campaign(plan)
    assert found.limit_notes == () and len(set(found.limit[:, 2])) == 3
    late = found.time >= found.from_s - 1e-9
    assert found.figures()["heading_deg"]["limit"] == pytest.approx(np.sqrt(np.mean(found.limit[:, 2] ** 2)))
    for place in range(3):
        own = limit_of(plan.plant_of(place)).at(found.time[late])["heading_deg"]
        assert found.limit[place, 2] == pytest.approx(np.sqrt(np.mean(own**2)), rel=0.02)

    many = run_campaign(make_plan(slow_ship(), "analytic", 9, first_seed=1, duration_s=1.0, variations=variations))
    assert np.isfinite(many.limit[:, 2]).nonzero()[0].tolist() == [0, 4, 8]
    assert many.as_json()["notes"][-1] == "limit: the root mean square over 3 of the 9 runs, evenly spaced"


def test_limits_of_runs_and_of_times_have_the_same_mean_square():
    """Runs told their heading more or less well: the limit of a run over its last quarter, that of a time over the runs."""
    variations = [parse_variation("knowledge.heading_sigma_deg=1:10")]
    found = run_campaign(make_plan(slow_ship(), "analytic", 4, first_seed=1, duration_s=2.0, variations=variations))
    late = found.time >= found.from_s - 1e-9
    for place, name in enumerate(found.channels):
        course, own = found.courses[name].limit, found.limit[:, place]
        if course is not None and np.isfinite(own).all():
            assert np.mean(course[late] ** 2) == pytest.approx(np.mean(own**2), rel=1e-9), name
    assert np.isfinite(found.limit[:, 2]).all()
    values = found.values[:, 0]
    assert found.limit[np.argmax(values), 2] > 1.2 * found.limit[np.argmin(values), 2]
