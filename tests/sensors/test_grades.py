"""Grades of sensors: their tables, sources and bounds."""

import math

import pytest

from insenv.sensors import GNSS_GRADES, IMU_GRADES, imu_grade
from insenv.sensors.gnss import GNSS_PARAMETERS, GnssSection
from insenv.sensors.imu_tables import IMU_PARAMETERS


def test_every_grade_fits_the_tables_and_every_figure_has_a_source() -> None:
    for grade in IMU_GRADES.values():
        IMU_PARAMETERS.pack(grade.parameters())
        for figure in grade.figures():
            assert grade.source(figure), (grade.name, figure)
        assert set(grade.sources) <= {"", *grade.figures(), "gyro_instability_time_s", "accel_instability_time_s"}
    for receiver in GNSS_GRADES.values():
        GNSS_PARAMETERS.pack(GnssSection(grade=receiver.name).error_rows())
        assert all(receiver.source(figure) for figure in receiver.figures)


def test_grades_in_si() -> None:
    paper = imu_grade("paper-quaternion").parameters()
    # 0.01 deg/h and 50 ug per sample at 200 Hz
    assert paper["angle_random_walk"] / math.sqrt(0.005) == pytest.approx(4.848e-8, rel=1e-4)
    assert paper["velocity_random_walk"] / math.sqrt(0.005) == pytest.approx(4.903e-4, rel=1e-3)
    assert paper["gyro_bias"] == pytest.approx([4.848e-8, 4.848e-8, -4.848e-8], rel=1e-4)
    assert IMU_PARAMETERS.pack(imu_grade("perfect").parameters()) == pytest.approx(IMU_PARAMETERS.start_vector())
    leador = imu_grade("leador").parameters()
    assert leador["accel_instability_sigma"] == pytest.approx(15e-5) and leador["velocity_random_walk"] == pytest.approx(5e-4)
    assert imu_grade("navigation").parameters()["velocity_random_walk"] == pytest.approx(20 * 9.80665e-6)
    assert GnssSection(grade="centimetre").error_rows()["gnss_position_noise"].tolist() == [0.01, 0.01, 0.02]
