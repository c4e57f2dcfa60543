"""The grades of inertial units by name.  Figures that a source does not state are omitted, or marked in `sources`."""

from __future__ import annotations

from typing import Any

from insenv.sensors.figures import find_grade, with_sources
from insenv.sensors.grades import ImuGrade
from insenv.sensors.units import m_s2_to_ug

_BIAS = "Groves 2013, table 4.1 (typical biases by grade)"
_DEMO = "Groves 2013, the book's MATLAB software, {}-grade IMU of its demos"
_RFU = "The paper's equal biases on right, forward, up, turned into forward, right, down"
_NO_TIME = "insenv's choice: the data sheet has no correlation time"
_TABLE = "a table of sensors in NAVIGATION, the journal of the ION"
_ONE_HOUR = f"1 h by {_TABLE}: not specified by the manufacturer"
_UPPER = "insenv's choice: the aviation grade's figure, an upper bound"
_BMI088 = "Bosch BMI088 data sheet, rev. 1.9"
_ICM42688 = "TDK ICM-42688-P data sheet, rev. 1.2"
_UNSTATED = "insenv's choice, the paper states none: " + _DEMO.format("aviation")


def _grade(name: str, title: str, source: str = "", **figures: Any) -> ImuGrade:
    """A grade from figures, each with the source of its own if it has one (`insenv.sensors.figures.with_sources`)."""
    values, sources = with_sources(source, figures)
    return ImuGrade(name, title, sources, **values)


def _quaternion(accel_white_ug: float) -> ImuGrade:
    return _grade(
        "paper-quaternion" if accel_white_ug == 50.0 else f"paper-quaternion-{accel_white_ug:.0f}ug",
        f"Unit of the quaternion adaptive Kalman paper, {accel_white_ug:.0f} ug of white noise",
        "Quaternion adaptive Kalman paper, simulation; white noises are std of a 200 Hz sample",
        gyro_bias_deg_h=((0.01, 0.01, -0.01), _RFU),
        gyro_white_deg_h=0.01,
        accel_bias_ug=((50.0, 50.0, -50.0), _RFU),
        accel_white_ug=accel_white_ug,
    )


_CONSUMER = _grade(
    "consumer",
    "Uncalibrated consumer MEMS",
    _DEMO.format("consumer") + ", rms of the matrices, rounded",
    gyro_bias_sigma_deg_h=(200.0, "Same software, rms of 180, 260, 160 deg/h; table 4.1: over 100 deg/h"),
    gyro_arw_deg_sqrt_h=1.0,
    gyro_scale_factor_sigma_ppm=30000.0,
    gyro_misalignment_sigma_urad=12000.0,
    gyro_g_sensitivity_deg_h_g=110.0,
    accel_bias_sigma_ug=(10000.0, "Same software, rms of 9, 13, 8 mg; table 4.1: over 3 mg"),
    accel_vrw_ug_sqrt_hz=1000.0,
    accel_scale_factor_sigma_ppm=45000.0,
    accel_misalignment_sigma_urad=11000.0,
)
_AUTOPILOT = _grade(
    "autopilot",
    "MEMS unit of autopilots, typical of the BMI088 and the ICM-42688-P, without the autopilot's calibration",
    f"{_BMI088}, typical value taken as 1 sigma",
    gyro_bias_sigma_deg_h=(3600.0, f"{_BMI088}: zero-rate offset +-1 deg/s, taken as 1 sigma; {_ICM42688}: +-0.5"),
    gyro_arw_deg_sqrt_h=(0.36, f"insenv's choice, 0.006 deg/s/sqrt(Hz): {_ICM42688}: 0.0028; {_BMI088}: 0.014"),
    gyro_scale_factor_sigma_ppm=(10000.0, f"{_BMI088}: sensitivity tolerance +-1 %, taken as 1 sigma; {_ICM42688}: +-0.5 %"),
    gyro_misalignment_sigma_urad=(10000.0, f"{_BMI088}: cross-axis sensitivity +-1 %, taken as 1 sigma; {_ICM42688}: +-1.25 %"),
    gyro_g_sensitivity_deg_h_g=(360.0, f"{_BMI088}: at most 0.1 deg/s/g; {_ICM42688}: not stated"),
    gyro_temperature_slope_deg_h_k=(54.0, f"{_BMI088}: +-0.015 deg/s/K; {_ICM42688}: +-0.005"),
    gyro_range_deg_s=(2000.0, f"{_BMI088} and {_ICM42688}: largest range"),
    accel_bias_sigma_ug=(20000.0, f"{_BMI088}: zero-g offset 20 mg, taken as 1 sigma; {_ICM42688}: +-20 mg"),
    accel_vrw_ug_sqrt_hz=(150.0, f"insenv's choice: {_ICM42688}: 65 (z 70); {_BMI088}: 160 (z 190)"),
    accel_scale_factor_sigma_ppm=(5000.0, f"{_ICM42688}: initial tolerance +-0.5 %, taken as 1 sigma; {_BMI088}: not stated"),
    accel_misalignment_sigma_urad=(5000.0, f"{_BMI088}: cross-axis sensitivity 0.5 %, taken as 1 sigma; {_ICM42688}: +-1 %"),
    accel_temperature_slope_ug_k=(200.0, f"{_BMI088}: less than 0.2 mg/K; {_ICM42688}: +-0.15"),
    accel_range_g=(16.0, f"{_ICM42688}: largest range; {_BMI088}: 24"),
)
_INDUSTRIAL = _grade(
    "industrial",
    "Factory-calibrated industrial MEMS, typical of the Analog Devices ADIS16488",
    "Analog Devices ADIS16488 data sheet, typical values",
    gyro_bias_sigma_deg_h=720.0,
    gyro_arw_deg_sqrt_h=0.3,
    gyro_instability_deg_h=6.25,
    gyro_instability_time_s=(300.0, _NO_TIME),
    gyro_range_deg_s=450.0,
    accel_bias_sigma_ug=16000.0,
    accel_vrw_m_s_sqrt_h=0.029,
    accel_instability_ug=100.0,
    accel_instability_time_s=(300.0, _NO_TIME),
    accel_range_g=18.0,
)
_TACTICAL = _grade(
    "tactical",
    "Tactical MEMS, typical of the Safran (Sensonor) STIM300 with 10 g accelerometers",
    "STIM300 data sheet, as quoted in the documentation of IS4S NavToolkit (stim300_model)",
    gyro_bias_sigma_deg_h=(4.0, f"STIM300 bias repeatability by {_TABLE}"),
    gyro_arw_deg_sqrt_h=0.15,
    gyro_instability_deg_h=0.5,
    gyro_instability_time_s=(3600.0, _ONE_HOUR),
    gyro_scale_factor_sigma_ppm=500.0,
    gyro_misalignment_sigma_urad=1000.0,
    gyro_g_sensitivity_deg_h_g=1.0,
    gyro_range_deg_s=(400.0, "STIM300 data sheet, input range"),
    accel_bias_sigma_ug=750.0,
    accel_vrw_m_s_sqrt_h=0.06,
    accel_instability_ug=50.0,
    accel_instability_time_s=(3600.0, _ONE_HOUR),
    accel_scale_factor_sigma_ppm=300.0,
    accel_misalignment_sigma_urad=1000.0,
    accel_range_g=(10.0, "STIM300 data sheet, input range of the 10 g accelerometers"),
)
_NAVIGATION = _grade(
    "navigation",
    "Aviation inertial reference unit (one nautical mile per hour)",
    _DEMO.format("aviation") + ", rms of the matrices, rounded",
    gyro_bias_sigma_deg_h=(0.01, _BIAS + ": aviation 0.01 deg/h"),
    gyro_arw_deg_sqrt_h=0.002,
    gyro_scale_factor_sigma_ppm=7.0,
    gyro_misalignment_sigma_urad=100.0,
    accel_bias_sigma_ug=(50.0, _BIAS + ": aviation 30 to 100 ug, here 50"),
    accel_vrw_ug_sqrt_hz=20.0,
    accel_scale_factor_sigma_ppm=100.0,
    accel_misalignment_sigma_urad=90.0,
)
_MARINE = _grade(
    "marine",
    "Ship's inertial navigator",
    _BIAS + ": marine 0.001 deg/h, 10 ug",
    gyro_bias_sigma_deg_h=0.001,
    gyro_arw_deg_sqrt_h=(0.002, _UPPER),
    gyro_scale_factor_sigma_ppm=(1.0, "Groves 2013, section 4.4: ring laser 1 to 100 ppm, the low end"),
    accel_bias_sigma_ug=10.0,
    accel_vrw_ug_sqrt_hz=(20.0, _UPPER),
    accel_scale_factor_sigma_ppm=(100.0, "Groves 2013, section 4.4: 100 to 1000 ppm, the low end"),
)
_ECEF = _grade(
    "paper-ecef",
    "Unit of the ECEF fine alignment paper, without noise (its table 1)",
    "ECEF fine alignment paper, simulation: 0.002 deg/h, 2e-4 m/s^2 on every axis",
    gyro_bias_deg_h=0.002,
    accel_bias_ug=float(m_s2_to_ug(2e-4)),
)
_AIRBORNE = _grade(
    "paper-airborne",
    "Unit of the airborne navigation paper",
    "Airborne navigation paper, flight test: 0.1 deg/h, 1e-3 g; read as 1 sigma of the turn-on bias",
    gyro_bias_sigma_deg_h=0.1,
    accel_bias_sigma_ug=1000.0,
)
_SWAYING = _grade(
    "paper-swaying",
    "Ring-laser unit of the swaying-base paper",
    "Swaying-base alignment paper, tests: 0.008 deg/h, 5e-5 g; read as 1 sigma of the turn-on bias",
    gyro_bias_sigma_deg_h=0.008,
    gyro_arw_deg_sqrt_h=(0.002, _UNSTATED),
    accel_bias_sigma_ug=50.0,
    accel_vrw_ug_sqrt_hz=(20.0, _UNSTATED),
)
_LSSVM = _grade(
    "paper-lssvm",
    "Unit of the LS-SVM large misalignment paper",
    "LS-SVM paper, simulation; random parts read as std of a 200 Hz sample",
    gyro_bias_deg_h=((0.05, 0.05, -0.05), _RFU),
    gyro_white_deg_h=0.05,
    accel_bias_ug=((50.0, 50.0, -50.0), _RFU),
    accel_white_ug=50.0,
)
_LEADOR = _grade(
    "leador",
    "Synthetic Leador-grade unit of KF-GINS",
    "KF-GINS, settings of its Leador data: 0.027 deg/h, 15 mGal (15.3 ug), 300 ppm, 4 h",
    gyro_arw_deg_sqrt_h=0.003,
    gyro_instability_deg_h=0.027,
    gyro_instability_time_s=14400.0,
    gyro_scale_factor_sigma_ppm=300.0,
    gyro_scale_factor_time_s=14400.0,
    accel_vrw_m_s_sqrt_h=0.03,
    accel_instability_ug=float(m_s2_to_ug(15e-5)),
    accel_instability_time_s=14400.0,
    accel_scale_factor_sigma_ppm=300.0,
    accel_scale_factor_time_s=14400.0,
)
_N380 = _grade(
    "n380",
    "Tuning for the Honeywell HGuide n380 log, larger than the errors of the unit",
    "Settings used with KF-GINS on the n380 log: 50 deg/h, 500 mGal (510 ug), 1 h",
    gyro_arw_deg_sqrt_h=0.3,
    gyro_instability_deg_h=50.0,
    accel_vrw_m_s_sqrt_h=0.1,
    accel_instability_ug=float(m_s2_to_ug(500e-5)),
)

IMU_GRADES: dict[str, ImuGrade] = {
    grade.name: grade
    for grade in (
        ImuGrade("perfect", "No errors"),
        *(_CONSUMER, _AUTOPILOT, _INDUSTRIAL, _TACTICAL, _NAVIGATION, _MARINE),
        *(_ECEF, _AIRBORNE, _SWAYING, *map(_quaternion, (50.0, 0.0, 100.0, 200.0)), _LSSVM),
        *(_LEADOR, _N380),
    )
}
"""IMU grades by name."""
CLASSES = (_CONSUMER, _AUTOPILOT, _INDUSTRIAL, _TACTICAL, _NAVIGATION)
"""The classes that the noise of an unknown unit can suggest, the coarsest first. `marine` has the noise of `navigation`."""


def imu_grade(name: str) -> ImuGrade:
    """The IMU grade of that name; raises `InputError`, naming the nearest, if there is none."""
    return find_grade(name, IMU_GRADES, "IMU grade")
