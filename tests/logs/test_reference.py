"""References in other axes and notations, against SciPy's rotations and pymap3d."""

import numpy as np
import pymap3d
import pytest
from scipy.spatial.transform import Rotation
from text_logs import RATE, as_text, imu_rows

from insenv import replay

TIME = imu_rows()[20:80:5, 0] - 0.5 / RATE  # middles of samples: the gyro rate is that of the sample
RATES = np.radians(imu_rows()[20:80:5, 1:4])
ANGLES = np.column_stack([np.full(TIME.size, 5.0), np.full(TIME.size, -20.0), 100.0 + TIME])  # roll, pitch, heading, deg
C_NB = Rotation.from_euler("ZYX", ANGLES[:, ::-1], degrees=True)
PLACE = np.column_stack([45 + 1e-5 * TIME, -93 + 1e-5 * TIME, 200 + TIME])
VELOCITY = np.column_stack([3 + 0 * TIME, TIME, 0.1 * TIME])  # NED
ENU = np.array([[0, 1, 0], [1, 0, 0], [0, 0, -1]])  # its own inverse
FLU = np.diag([1, -1, -1])
ARM = np.array([0.5, -1.0, -2.0])
ORIGIN = (45.02, -93.03, 150.0)
C_EN = np.stack([np.column_stack([pymap3d.enu2uvw(*axis, *p[:2]) for axis in ENU]) for p in PLACE])
OF_ORIGIN = np.array([pymap3d.uvw2enu(*each, *ORIGIN[:2]) for each in np.eye(3)]).T  # C from e to ENU there
AXES = 'navigation_axes = "ENU"\naxes = "FLU"\n'
QUATERNION = 'quaternion = ["q0", "q1", "q2", "q3"]\nquaternion_order = "{}"\nquaternion_direction = "{}"\n'
LOCAL = (
    'position_local = ["x", "y", "z"]\norigin_latitude_deg = 45.02\norigin_longitude_deg = -93.03\norigin_height_m = 150.0\n'
)


def at_point(arm):
    """Position and velocity of the point at the end of a lever arm; NED is that of the IMU, 3e-7 rad off."""
    place = np.column_stack(pymap3d.ned2geodetic(*C_NB.apply(arm).T, *PLACE.T))
    return place, VELOCITY + C_NB.apply(np.cross(RATES, arm))


def form(name):
    """Names of the columns, these (n, k), and the keys, of three notations of the same reference."""
    place, velocity = at_point(ARM if name == "ecef" else np.zeros(3))
    if name == "angles":
        keys = 'latitude = "a"\nlongitude = "b"\nheight = "c"\nposition_unit = "deg"\nvelocity = ["u", "v", "w"]\n'
        keys += 'roll = "r"\npitch = "p"\nheading = "h"\nattitude_unit = "deg"\n'
        return "a,b,c,u,v,w,r,p,h", np.hstack([place, velocity, ANGLES]), keys
    if name == "ecef":
        columns = [
            np.column_stack(pymap3d.geodetic2ecef(*place.T)),
            np.einsum("kij,kj->ki", C_EN, velocity),
            C_NB.inv().as_quat(),
        ]
        keys = 'position_ecef = ["x", "y", "z"]\nvelocity_ecef = ["u", "v", "w"]\nlever_arm_m = [0.5, -1.0, -2.0]\n'
        return "x,y,z,u,v,w,q0,q1,q2,q3", np.hstack(columns), keys + QUATERNION.format("xyzw", "nav-to-body")
    turned = OF_ORIGIN @ C_EN  # from NED at the place to ENU at the origin
    q = Rotation.from_matrix(turned @ C_NB.as_matrix() @ FLU).as_quat()[:, [3, 0, 1, 2]]
    columns = [np.column_stack(pymap3d.geodetic2enu(*place.T, *ORIGIN)), np.einsum("kij,kj->ki", turned, velocity), q]
    keys = LOCAL + 'velocity = ["u", "v", "w"]\n' + AXES + QUATERNION.format("wxyz", "body-to-nav")
    return "x,y,z,u,v,w,q0,q1,q2,q3", np.hstack(columns), keys


def write(folder, names, columns, keys):
    folder.write("truth.csv", as_text(np.column_stack([TIME + 3.0, columns]), "t," + names))
    folder.toml += f'[reference]\nfile = "truth.csv"\ntime = "t"\ntime_offset_s = -3.0\n{keys}'


@pytest.mark.parametrize("name", ["angles", "ecef", "local"])
def test_each_notation_means_the_same(folder, name):
    write(folder, *form(name))
    reference = folder.load().reference
    np.testing.assert_allclose(reference.time, TIME, rtol=1e-10)
    np.testing.assert_allclose(np.degrees([reference.roll, reference.pitch, reference.heading]).T, ANGLES, atol=1e-6)
    np.testing.assert_allclose(reference.velocity_n, VELOCITY, atol=5e-6)
    np.testing.assert_allclose(np.degrees([reference.latitude, reference.longitude]).T, PLACE[:, :2], atol=1e-10)
    np.testing.assert_allclose(reference.height, PLACE[:, 2], atol=1e-4)
    assert reference.lever_arm_b is None


def test_attitude_alone_and_what_does_not_go_together(folder):
    names, columns, _ = form("local")
    q = Rotation.from_matrix(ENU @ C_NB.as_matrix() @ FLU).as_quat()[:, [3, 0, 1, 2]]
    write(folder, names, np.hstack([columns[:, :6], q]), AXES + QUATERNION.format("wxyz", "body-to-nav"))
    reference = folder.load().reference
    np.testing.assert_allclose(np.degrees(reference.heading), ANGLES[:, 2], atol=1e-6)
    assert reference.latitude is None and reference.velocity_n is None
    folder.change(("quaternion_direction", 'velocity_ecef = ["u", "v", "w"]\nvelocity = ["u", "v", "w"]\n#'))
    together = "quaternion, quaternion_order and quaternion_direction go together; only quaternion, quaternion_order given"
    folder.error(together, "velocity and velocity_ecef exclude one another", "velocity_ecef needs position_ecef")
    write(folder, names, np.hstack([columns[:, :6], 0 * q]), "")
    folder.toml = folder.toml[: folder.toml.rindex("[reference]")]
    folder.change(('velocity_ecef = ["u", "v", "w"]\nvelocity = ["u", "v", "w"]\n#', "quaternion_direction"))
    folder.error("truth.csv: line 2, column 'q0': the quaternion has the length 0, allowed is 1 (12 such values; keep_where")


def test_a_reference_without_attitude_is_compared_at_its_own_point(folder):
    """The errors of an estimate do not change if the reference is that of a point beside the IMU."""
    errors = []
    for arm in (np.zeros(3), ARM):
        folder.toml = type(folder)(folder.path).toml + "[initial]\nroll_deg = 0.0\npitch_deg = 0.0\nheading_deg = 90.0\n"
        folder.toml += 'start_s = 10.3\n[estimator."loosely-coupled"]\n'
        keys = 'latitude = "a"\nlongitude = "b"\nheight = "c"\nposition_unit = "deg"\n' + f"lever_arm_m = {arm.tolist()}\n"
        write(folder, "a,b,c", PLACE, keys)
        result = replay(folder.load(), "loosely-coupled").results[0]
        moved = Rotation.from_quat(result.outputs["q_nb"][:, [1, 2, 3, 0]]).apply(arm)
        errors.append(np.column_stack([result.errors[name] for name in ("north_m", "east_m", "down_m")]) - moved)
    np.testing.assert_allclose(*errors, atol=1e-6)
