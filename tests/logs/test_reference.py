"""References in other axes and notations, against SciPy's rotations and pymap3d."""

from functools import partial

import numpy as np
import pymap3d
import pytest
from scipy.spatial.transform import Rotation
from text_logs import RATE, as_text, imu_rows

from insenv import replay

TIME = imu_rows()[20:80:5, 0] - 0.5 / RATE  # middles of samples: the gyro rate is that of the sample
RATES = np.radians(imu_rows()[20:80:5, 1:4])
ANGLES = np.column_stack([5.0 + 0 * TIME, -20.0 + 0 * TIME, 100.0 + TIME])  # roll, pitch, heading, deg
C_NB = Rotation.from_euler("ZYX", ANGLES[:, ::-1], degrees=True)
PLACE, VELOCITY = (
    np.column_stack([45 + 1e-5 * TIME, -93 + 1e-5 * TIME, 200 + TIME]),
    np.column_stack([3 + 0 * TIME, TIME, 0.1 * TIME]),
)
ENU, FLU = np.array([[0, 1, 0], [1, 0, 0], [0, 0, -1]]), np.diag([1, -1, -1])  # their own inverses
ARM, ORIGIN = np.array([0.5, -1.0, -2.0]), (45.02, -93.03, 150.0)
C_EN = np.stack([np.column_stack([pymap3d.enu2uvw(*axis, *place[:2]) for axis in ENU]) for place in PLACE])
OF_ORIGIN = np.array([pymap3d.uvw2enu(*each, *ORIGIN[:2]) for each in np.eye(3)]).T @ C_EN  # from NED at the place to ENU there
POINTS = {"N": [1, 0, 0], "E": [0, 1, 0], "D": [0, 0, 1], "W": [0, -1, 0], "U": [0, 0, -1]}  # of an axis, in NED
COLUMNS = "x,y,z,u,v,w,q0,q1,q2,q3"
QUATERNION = 'quaternion = ["q0", "q1", "q2", "q3"]\nquaternion_order = "{}"\nquaternion_direction = "{}"\n'
AXES = 'navigation_axes = "ENU"\naxes = "FLU"\n' + QUATERNION.format("wxyz", "body-to-nav")
LOCAL = (
    'origin_latitude_deg = 45.02\norigin_longitude_deg = -93.03\norigin_height_m = 150.0\nvelocity = ["u", "v", "w"]\n' + AXES
)
PLACED = 'latitude = "x"\nlongitude = "y"\nheight = "z"\nposition_unit = "deg"\n'


def in_ecef():
    """Of a point at the end of a lever arm; the quaternion takes n to b, the scalar last."""
    place = np.column_stack(pymap3d.ned2geodetic(*C_NB.apply(ARM).T, *PLACE.T))
    velocity = np.einsum("kij,kj->ki", C_EN, VELOCITY + C_NB.apply(np.cross(RATES, ARM)))
    keys = 'position_ecef = ["x", "y", "z"]\nvelocity_ecef = ["u", "v", "w"]\nlever_arm_m = [0.5, -1.0, -2.0]\n'
    columns = np.hstack([np.column_stack(pymap3d.geodetic2ecef(*place.T)), velocity, C_NB.inv().as_quat()])
    return columns, keys + QUATERNION.format("xyzw", "nav-to-body")


def in_local_axes(axes):
    of_enu = np.array([POINTS[axis] for axis in axes]) @ ENU
    turn = of_enu @ OF_ORIGIN
    q = Rotation.from_matrix(turn @ C_NB.as_matrix() @ FLU).as_quat()[:, [3, 0, 1, 2]]
    place, velocity = np.column_stack(pymap3d.geodetic2enu(*PLACE.T, *ORIGIN)), np.einsum("kij,kj->ki", turn, VELOCITY)
    return np.hstack([place @ of_enu.T, velocity, q]), 'position_local = ["x", "y", "z"]\n' + LOCAL.replace("ENU", axes)


def written(folder, columns, keys):
    folder.write("truth.csv", as_text(np.column_stack([TIME + 3.0, columns]), f"t,{COLUMNS}"))
    folder.toml = f'{type(folder)(folder.path).toml}[reference]\nfile = "truth.csv"\ntime = "t"\ntime_offset_s = -3.0\n{keys}'
    return folder


@pytest.mark.parametrize("form", [in_ecef, *(partial(in_local_axes, axes) for axes in ("NED", "ENU", "NWU"))])
def test_each_notation_means_the_same(folder, form):
    reference = written(folder, *form()).load().reference
    np.testing.assert_allclose(reference.time, TIME, rtol=1e-10)
    np.testing.assert_allclose(np.degrees([reference.roll, reference.pitch, reference.heading]).T, ANGLES, atol=1e-6)
    np.testing.assert_allclose(reference.velocity_n, VELOCITY, atol=5e-6)  # NED is that of the IMU, 3e-7 rad off
    np.testing.assert_allclose(np.degrees([reference.latitude, reference.longitude]).T, PLACE[:, :2], atol=1e-10)
    np.testing.assert_allclose(reference.height, PLACE[:, 2], atol=1e-4)


def test_attitude_alone_and_what_does_not_go_together(folder):
    q = Rotation.from_matrix(ENU @ C_NB.as_matrix() @ FLU).as_quat()[:, [3, 0, 1, 2]]
    columns = np.hstack([PLACE, VELOCITY, q])
    reference = written(folder, columns, f"{AXES}attitude_sigma_deg = [0.5, 0.5, 2.0]\n").load().reference
    np.testing.assert_allclose(np.degrees(reference.heading), ANGLES[:, 2], atol=1e-6)
    np.testing.assert_allclose(np.degrees(reference.attitude_sigma), [0.5, 0.5, 2.0])
    assert reference.latitude is None and reference.velocity_n is None
    written(folder, 0 * columns, AXES).error(
        "line 2, column 'q0': the quaternion has the length 0, allowed is 1 (12 such values"
    )
    written(folder, columns, LOCAL.replace("quaternion_d", 'velocity_ecef = ["u", "v", "w"]\n#'))
    together = "quaternion, quaternion_order and quaternion_direction go together; only quaternion, quaternion_order given"
    folder.error(together, "velocity and velocity_ecef exclude one another", "velocity_ecef needs position_ecef",
        "position_local")  # fmt: skip


def test_a_reference_without_attitude_is_compared_at_its_own_point(folder):
    """Said to be that of a point beside the IMU, it changes the errors by the lever arm in the attitude of the estimate."""
    errors, state = [], "[initial]\nroll_deg = 0.0\npitch_deg = 0.0\nheading_deg = 90.0\nstart_s = 10.3\n"
    for arm in (np.zeros(3), ARM):
        written(folder, np.hstack([PLACE, np.zeros((12, 7))]), f"{PLACED}lever_arm_m = {arm.tolist()}\n{state}")
        result = replay(folder.load(), "loosely-coupled").results[0]
        moved = Rotation.from_quat(result.outputs["q_nb"][:, [1, 2, 3, 0]]).apply(arm)
        errors.append(np.column_stack([result.errors[name] for name in ("north_m", "east_m", "down_m")]) - moved)
    np.testing.assert_allclose(*errors, atol=1e-6)
