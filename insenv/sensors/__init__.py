"""Sensors: inertial measurement unit, GNSS receiver, and the catalogue of their grades."""

from insenv.sensors.catalogue import GNSS_GRADES, IMU_GRADES, gnss_grade, imu_grade
from insenv.sensors.contract import Instant, Sensor, SensorSection
from insenv.sensors.gnss import GNSS, GnssSection
from insenv.sensors.grades import GnssGrade, ImuGrade
from insenv.sensors.imu import IMU, SENSOR_ERROR, ImuSection

__all__ = [
    "GNSS",
    "GNSS_GRADES",
    "IMU",
    "IMU_GRADES",
    "SENSOR_ERROR",
    "GnssGrade",
    "GnssSection",
    "ImuGrade",
    "ImuSection",
    "Instant",
    "Sensor",
    "SensorSection",
    "gnss_grade",
    "imu_grade",
]
