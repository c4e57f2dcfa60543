"""Parameters of the streamed vehicle: their names, what they change and when, wrong values."""

from math import nan

import numpy as np
import pytest
from streamed_vehicle import answered, quiet, sent, set_parameter, steps, texts

from insenv import estimators
from insenv.base.errors import InputError
from insenv.mavlink.parameters import NEVER, NEXT_ALIGNMENT, NOW
from insenv.scenario import build, load
from insenv.sensors.grades import LONGEST_NAME, elements


def asked(vehicle, name, index=-1):
    (answer,) = answered(vehicle, sent("PARAM_REQUEST_READ", 1, 1, name, index))
    return answer


def test_all_parameters_are_sent_as_real32_with_short_names():
    vehicle = quiet()
    listed = answered(vehicle, sent("PARAM_REQUEST_LIST", 1, 1))
    assert len(listed) == len(vehicle.parameters) > 100
    assert [m.param_index for m in listed] == list(range(len(listed))) and {m.param_type for m in listed} == {9}
    values, plant = {m.param_id: m.param_value for m in listed}, vehicle.simulation.plant
    assert len(values) == len(listed) and all(len(name) <= LONGEST_NAME for name in values)
    assert values["SIM_SPEED"] == 1 and values["SIM_RATE"] == 200 and values["E_INN_GATE"] == 5
    arw = np.degrees(plant.knowledge.sensors.angle_random_walk) * 60
    assert values["E_ANG_R_W"] == pytest.approx(arw, rel=1e-7)  # deg/sqrt(h)
    one = asked(vehicle, b"E_INN_GATE")
    assert one.param_value == 5 and one.param_id == "E_INN_GATE" == asked(vehicle, b"", one.param_index).param_id
    wrong = asked(vehicle, b"", 30000)
    assert (wrong.get_type(), wrong.param_id, wrong.param_index, wrong.error) == ("PARAM_ERROR", "", 30000, 1)
    (wrong,) = answered(vehicle, sent("PARAM_SET", 1, 1, b"NONE", 1.0, 9))
    assert (wrong.get_type(), wrong.error) == ("PARAM_ERROR", 1)


def test_every_estimator_and_plant_has_names_for_its_parameters():
    plants = [("S", build(load(name)).model) for name in ("ship-irregular-sea", "car-city-drive", "aircraft-survey")]
    for prefix, model in [*plants, *(("E", e.model) for e in estimators.registered().values())]:
        ids = [name for _, _, name in elements(prefix, model.parameters, model.parameters.names)]
        assert len(set(ids)) == len(ids) and all(len(name) <= LONGEST_NAME and name.isascii() for name in ids)


def test_a_parameter_acts_at_once_or_announces_when():
    vehicle, untouched = quiet(), quiet()
    assert set_parameter(vehicle, "E_ANG_R_W", 30.0) == 30.0
    steps(vehicle, 2.0), steps(untouched, 2.0)
    assert vehicle.simulation.estimate["attitude_sigma"][0] > 1.5 * untouched.simulation.estimate["attitude_sigma"][0]
    np.testing.assert_array_equal(vehicle.simulation.truth["q_nb"], untouched.simulation.truth["q_nb"])
    assert {p.acts for p in vehicle.parameters.all} == {NOW, NEXT_ALIGNMENT, NEVER}

    vehicle.texts()
    assert set_parameter(vehicle, "E_HDG_SIG", 90.0) == 90.0
    assert texts(vehicle) == ["E_HDG_SIG: acts at next alignment"]
    vehicle.realign()
    assert np.degrees(vehicle.simulation.estimate["attitude_sigma"][2]) == pytest.approx(90.0)
    assert asked(vehicle, b"E_ANG_R_W").param_value == 30.0  # it stays in force


def test_the_undulation_is_given_before_the_start():
    vehicle = quiet(undulation=47.0)
    assert asked(vehicle, b"SIM_UNDULATION").param_value == 47.0 == vehicle.view.undulation
    assert set_parameter(vehicle, "SIM_UNDULATION", 0.0) == 47.0 == vehicle.view.undulation
    assert texts(vehicle) == ["SIM_UNDULATION cannot be set during a run"]
    with pytest.raises(InputError, match="allowed is -120 to 120 m"):
        quiet(undulation=121.0)


@pytest.mark.parametrize(
    "name, value, kind",
    [
        ("E_INN_GATE", nan, 9),
        ("E_INN_GATE", -1.0, 9),
        ("E_INN_GATE", 6.0, 6),
        ("S_GYR_BIAS_X", 1.0, 9),
        ("SIM_RATE", 100.0, 9),
    ],
)
def test_a_wrong_value_changes_nothing_and_is_announced(name, value, kind):
    vehicle = quiet()
    before = vehicle.parameters.all[vehicle.parameters.find(name)].value()
    assert set_parameter(vehicle, name, value, kind) == pytest.approx(before, rel=1e-7)
    assert any(name in text for text in texts(vehicle))
