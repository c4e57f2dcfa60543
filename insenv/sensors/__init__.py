"""Sensors: inertial measurement unit, GNSS receiver, and the catalogue of their grades."""

from insenv.sensors.catalogue import IMU_GRADES, imu_grade
from insenv.sensors.contract import Instant, Sensor, SensorSection
from insenv.sensors.figures import Grade
from insenv.sensors.gnss import GNSS, GNSS_GRADES, GnssSection, gnss_grade
from insenv.sensors.grades import ImuGrade
from insenv.sensors.imu import IMU, SENSOR_ERROR, ImuSection

__all__ = [
    "GNSS",
    "GNSS_GRADES",
    "IMU",
    "IMU_GRADES",
    "SENSOR_ERROR",
    "GnssSection",
    "Grade",
    "ImuGrade",
    "ImuSection",
    "Instant",
    "Sensor",
    "SensorSection",
    "gnss_grade",
    "imu_grade",
]
