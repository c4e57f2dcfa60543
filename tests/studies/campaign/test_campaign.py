"""What a run of a campaign is, and the command: lines, files and refusals."""

import json

import numpy as np
import pytest
from command_line import call

from insenv import run
from insenv.evaluation.errors import ATTITUDE, CHANNELS
from insenv.scenario import build, load, reseeded
from insenv.studies.campaign import make_plan, run_campaign
from insenv.studies.campaign.block import run_block


@pytest.mark.parametrize(("name", "id"), [("ship-swaying", "q-method"), ("car-city-drive", "loosely-coupled")])
def test_a_run_of_a_campaign_is_the_run_of_its_seed(name, id):
    """Errors and stated accuracy at the recorded times, and mean squares in between, equal those of `insenv.runs.simulated`.

    So does the limit, which no seed changes: of an alignment from where its statistics begin, of a navigation from the start.
    """
    scenario = load(name).model_copy(update={"rate_hz": 100.0})
    plan = make_plan(scenario, id, 3, first_seed=11, duration_s=6.0)
    arrays, k, found = run_block(plan, 0), plan.evaluations, run_campaign(plan)
    result = run(scenario, [id], seed=12, duration_s=6.0).results[0]
    assert np.allclose(plan.times, result.time[k - 1 :: k], rtol=1e-12)

    def means(values):
        return (values[: len(plan.times) * k] ** 2).reshape(-1, k).mean(axis=1)

    for place, channel in enumerate(c for c in CHANNELS if c in result.errors):
        error, sigma = result.errors[channel], result.sigma.get(channel)
        assert np.allclose(arrays["error"][1, :, place], error[k - 1 :: k], rtol=1e-9, atol=1e-9)
        assert np.allclose(arrays["mean_square"][1, :, place], means(error), rtol=1e-6, atol=1e-15)
        if sigma is not None:
            assert np.allclose(arrays["sigma"][1, :, place], sigma[k - 1 :: k], rtol=1e-9)
            assert np.allclose(arrays["mean_variance"][1, :, place], means(sigma), rtol=1e-9)
    late = found.time >= found.from_s - 1e-9
    inside = result.time > found.time[late][0] - found.time[0] + 1e-9  # a record holds the evaluations since the one before
    for place, channel in enumerate(found.channels):
        expected = np.sqrt(np.mean(result.limit_sigma[channel][inside] ** 2))
        assert found.limit[:, place] == pytest.approx(expected, rel=1e-9), channel
        assert found.figures()[channel]["limit"] == pytest.approx(expected, rel=1e-9)
        assert np.sqrt(np.mean(found.courses[channel].limit[late] ** 2)) == pytest.approx(expected, rel=1e-9)
        if found.from_s == 0.0:
            assert expected == pytest.approx(result.limit[channel], rel=1e-9)
    assert found.notes == found.plan.notes


def test_reseeded_plants_are_those_built_for_the_seeds():
    for name in ("car-city-drive", "ship-irregular-sea"):
        first = build(load(name), seed=1, duration_s=50.0)
        for plant, seed in zip(reseeded(first, [4, 9]), (4, 9), strict=True):
            other = build(load(name), seed=seed, duration_s=50.0)
            assert plant.seed == seed and np.array_equal(*(p.model.parameters.pack(p.parameters) for p in (plant, other)))
            assert repr(plant.knowledge) == repr(other.knowledge)


COMMAND = ("campaign", "ship-swaying", "-e", "analytic", "-n", "6", "--duration", "1")


def test_the_command(tmp_path):
    """Its files are the same in every folder."""
    given = (*COMMAND, "--seed", "5", "--vary", "start.latitude_deg=10:40", "--no-figure")
    status, out, err = call(*given, "--out", tmp_path / "one")
    assert (status, err) == (0, "") and "6 runs of 1 s, seeds 5 to 10" in out
    for name, more in (("one", ("--resume",)), ("two", ())):
        status, out, _ = call(*given, "--out", tmp_path / name, "--json", *more)
        found = json.loads(out)
        assert status == 0 and found["runs"] == 6 and found["imu_samples"] == 1200 and found["nees"] is None
        assert found["files"] == [str(tmp_path / name / file) for file in ("campaign.npz", "campaign.json")]
    (varied,) = found["varied"]
    assert varied["key"] == "start.latitude_deg" and varied["parameters"] == [10.0, 40.0]
    assert found["errors"].keys() == set(ATTITUDE)
    one, two = ((tmp_path / name / "campaign.json").read_bytes() for name in ("one", "two"))
    assert one == two and json.loads(one)["files"] == ["campaign.npz", "campaign.json"]
    status, _, err = call(*COMMAND, "--seed", "5", "--out", tmp_path / "one")
    assert status == 2 and "another campaign: it differs in variations" in err
