"""A correction keeps the sum of field and iron: its algebra, and what that makes of heading and sigma."""

import casadi as ca
import numpy as np
import pytest
from changed_scenario import changed
from constants import number
from scipy.linalg import expm
from scipy.spatial.transform import Rotation

import insenv
from insenv.core import symmetric
from insenv.core.model import Values
from insenv.estimators.fusion import kept_sum
from insenv.estimators.fusion.available import composition
from insenv.estimators.fusion.measurement import derived
from insenv.estimators.fusion.navigation import corrected
from insenv.estimators.parts import adjoint
from insenv.estimators.parts.error_model import POSITION, TILT, VELOCITY, with_platform

IRON = ("hard_iron", "soft_iron", "soft_iron_coupling", "magnetic_field_error")


def symbols(filter):
    tables = (filter.parameters, filter.state, filter.inputs)
    flat = [ca.SX.sym(name, table.size) for name, table in zip("pxu", tables, strict=True)]
    return flat, [table.symbols(each) for table, each in zip(tables, flat, strict=True)]


def point(filter, generator):
    """Plausible numbers of parameters, state and inputs."""
    given = {
        "q_wb": Rotation.from_euler("ZYX", [0.7, 0.2, -0.3]).as_quat(scalar_first=True), "q_ew": np.array([1.0, 0, 0, 0]),
        "magnetic_field_n": np.array([2e-5, 1e-6, 4e-5]), "hard_iron": np.array([3e-6, -5e-6, 1e-6]),
        "soft_iron_coupling": 0.05 * generator.standard_normal(6), "dt": 0.005,
    }  # fmt: skip
    tables = (filter.parameters, filter.state, filter.inputs)
    return [np.concatenate([np.ravel(given.get(row.name, row.flat_start())) for row in table]) for table in tables]


@pytest.mark.parametrize("turn", [(0.0, 0.0, 0.2), (0.1, -0.15, 0.4)])
def test_what_the_magnetometer_shows_is_corrected_to_first_order_and_its_error_stays(turn):
    filter, generator = composition("iron", IRON, ("magnetometer",)), np.random.default_rng(1)
    (aid,) = filter.summing
    flat, (p, x, u) = symbols(filter)
    c = ca.SX.sym("c", filter.n)
    before, R = derived(aid, filter.states, filter.places, filter.n, p, x, u)
    rows = corrected(x, c, filter.states, filter.places)
    iron, change = kept_sum.kept(aid, filter.states, filter.places, p, x, u, c, rows)
    after, R_after = derived(
        aid, filter.states, filter.places, filter.n, p, Values(**{**vars(x), **rows, "hard_iron": iron}), u
    )
    outputs = [before + R @ c - after, ca.densify(R), ca.densify(R_after), ca.densify(change)]
    correction = 1e-3 * generator.standard_normal(filter.n)
    correction[POSITION], correction[VELOCITY], correction[TILT] = 0.0, 0.0, turn
    correction[filter.places["hard_iron"]] = 1e-6
    left, R, R_after, change = (
        np.array(each) for each in ca.Function("f", [*flat, c], outputs)(*point(filter, generator), correction)
    )
    assert np.abs(left).max() < 1e-15  # T, of a field of 4e-5 T
    # an error e before the correction is e' = T T_turn e after it, and R' e' = R e
    platform = np.eye(filter.n)
    C = expm(np.cross(np.eye(3), turn))
    for part, block in with_platform(C):
        platform[part, part] = block
    T = np.eye(filter.n)
    T[filter.places["hard_iron"], :] += change
    assert R_after @ T @ platform == pytest.approx(R, rel=1e-12, abs=1e-18)
    assert np.abs(change[:, TILT]).max() > 1e-7 and not change[:, filter.places["hard_iron"]].any()


def test_a_covariance_is_carried_over_with_that_error():
    generator = np.random.default_rng(2)
    root, change = generator.standard_normal((6, 6)), np.zeros((2, 6))
    change[:, [0, 3]] = generator.standard_normal((2, 2))
    T = np.eye(6)
    T[4:, :] += change
    P = kept_sum.covariance_kept(symmetric.triangle(ca.SX(root @ root.T)), slice(4, 6), ca.sparsify(ca.SX(change)))
    assert number(symmetric.full(P, 6)) == pytest.approx(T @ root @ root.T @ T.T)


def test_a_smoother_goes_back_over_it():
    """s <- T^T s, L <- T^T L T."""
    generator = np.random.default_rng(3)
    shear, block, s = adjoint.Shear((4, 5), (0, 3)), generator.standard_normal((2, 2)), generator.standard_normal(6)
    root, T = generator.standard_normal((6, 6)), np.eye(6)
    T[np.ix_(shear.rows, shear.columns)] = block
    x = Values(adjoint=ca.SX(s), information=symmetric.triangle(ca.SX(root @ root.T)))
    back = adjoint._back_over_shear(6, shear, None, x, Values(shear=ca.SX(block)))
    assert number(back["adjoint"]).ravel() == pytest.approx(T.T @ s)
    assert number(symmetric.full(back["information"], 6)) == pytest.approx(T.T @ root @ root.T @ T)


HOVER = changed("multirotor-hover", magnetometer={"hard_iron_sigma_nt": 10_000.0})


def test_iron_and_heading_that_make_up_for_each_other_are_not_told_apart():
    """Mean NEES of 9 states over the first 20 s, 12 seeds: 35, and a heading 3.1 times as stated, if none keeps the sum."""
    summary = insenv.campaign(HOVER, "fusion", runs=12, seed=964000, duration_s=20.0)
    heading = summary.courses["heading_deg"]
    assert 6.0 < np.mean(summary.nees.mean) < 12.5
    assert 0.6 < np.sqrt(np.mean(heading.rms**2) / np.mean(heading.stated**2)) < 1.5


@pytest.mark.slow
def test_a_smoother_of_them_is_honest_from_the_start():
    ratios = []
    for seed in range(964100, 964112):
        (result,) = insenv.run(HOVER, "fusion-smoother", seed=seed, duration_s=40.0).results
        ratios.append(result.errors["heading_deg"] / result.sigma["heading_deg"])
    assert 0.6 < np.sqrt(np.mean(np.square(ratios))) < 1.5 and np.abs(ratios).max() < 4.5


@pytest.mark.parametrize("off_deg", [-60.0, 25.0])
def test_the_covariance_after_a_reading_does_not_depend_on_the_heading_that_was_assumed(off_deg):
    """One exact reading of a level vehicle, its level known to 3 deg, its heading to 180: as from the right heading."""
    filter = composition("iron", IRON, ("magnetometer",))
    (aid,), n = filter.aids, filter.n
    flat, (p, x, u) = symbols(filter)
    x = Values(**{**vars(x), **filter.shown(aid)(p, x, u)})
    rows, _ = filter.fed_back(aid, p, x, u, filter.update(aid, p, x, u)[0])
    step = ca.Function("step", flat, [ca.densify(rows[name]) for name in ("q_wb", "covariance", "hard_iron")])
    sigma = np.full(n, 1e-9)
    sigma[TILT] = np.radians([3.0, 3.0, 180.0])
    sigma[filter.places["hard_iron"]] = 0.5e-6
    field = np.array([2e-5, 1e-6, 4e-5])
    told = {
        "covariance": symmetric.triangle_of_diagonal(sigma**2), "magnetic_field_n": field, "q_ew": np.array([1.0, 0, 0, 0]),
        "magnetometer_noise": 0.3e-6, "magnetometer_field_b": Rotation.from_euler("z", 0.7).inv().apply(field), "dt": 0.005,
    }  # fmt: skip

    def after(heading):
        given = {**told, "q_wb": Rotation.from_euler("z", heading).as_quat(scalar_first=True)}
        tables = (filter.parameters, filter.state, filter.inputs)
        values = [np.concatenate([np.ravel(given.get(row.name, row.flat_start())) for row in table]) for table in tables]
        q, P, iron = (np.array(each).ravel() for each in step(*values))
        return Rotation.from_quat(q, scalar_first=True), symmetric.full_array(P[None], n)[0], iron

    right, P_right, _ = after(0.7)
    q, P, iron = after(0.7 + np.radians(off_deg))
    assert (q * right.inv()).magnitude() < np.radians(0.2) and np.abs(iron).max() < 0.1e-6
    places = np.r_[TILT, filter.places["hard_iron"]]
    scale = np.sqrt(np.diag(P_right)[places])
    assert P[np.ix_(places, places)] / np.outer(scale, scale) == pytest.approx(
        P_right[np.ix_(places, places)] / np.outer(scale, scale), abs=0.05
    )
