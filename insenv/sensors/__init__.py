"""Sensors: inertial measurement unit, GNSS receiver, and the catalogue of their grades."""

from insenv.sensors.catalogue import GNSS_GRADES, IMU_GRADES, gnss_grade, imu_grade
from insenv.sensors.gnss import GNSS_PARAMETERS, GNSS_STATE, check_timing, gnss_part
from insenv.sensors.grades import GnssGrade, ImuGrade
from insenv.sensors.imu import imu_part
from insenv.sensors.imu_tables import IMU_PARAMETERS, IMU_STATE

__all__ = [
    "GNSS_GRADES",
    "GNSS_PARAMETERS",
    "GNSS_STATE",
    "IMU_GRADES",
    "IMU_PARAMETERS",
    "IMU_STATE",
    "GnssGrade",
    "ImuGrade",
    "check_timing",
    "gnss_grade",
    "gnss_part",
    "imu_grade",
    "imu_part",
]
