"""Functions of the Earth for CasADi symbols, and physical constants; ``geodesy.numeric`` has the functions for NumPy
arrays.

n = north-east-down, e = Earth-centred Earth-fixed, w = wander azimuth. Latitude, longitude and wander angle are in
radians, heights above the WGS-84 ellipsoid and positions in metres.
"""

from insenv.geodesy import numeric
from insenv.geodesy.frames import (
    C_en,
    C_ew,
    earth_rate_n,
    earth_rate_w,
    geodetic_from_q_ew,
    q_ew_from_geodetic,
    transport_rate_about_axis,
    transport_rate_n,
    transport_rate_w,
)
from insenv.geodesy.position import (
    ecef_to_geodetic,
    geodetic_from_ned_offset,
    geodetic_to_ecef,
    ned_offset,
    position_error,
)
from insenv.geodesy.wgs84 import (
    E2,
    GAMMA_EQUATOR,
    GAMMA_POLE,
    GM,
    GRAVITY_CHANGE,
    MEAN_RADIUS,
    NOMINAL_GRAVITY,
    OMEGA_IE,
    POLAR_RADIUS,
    SOMIGLIANA,
    STANDARD_GRAVITY,
    A,
    B,
    F,
    M,
    normal_gravity,
    normal_gravity_about_axis,
    normal_gravity_paper,
    radii,
)

__all__ = [
    "E2",
    "GAMMA_EQUATOR",
    "GAMMA_POLE",
    "GM",
    "GRAVITY_CHANGE",
    "MEAN_RADIUS",
    "NOMINAL_GRAVITY",
    "OMEGA_IE",
    "POLAR_RADIUS",
    "SOMIGLIANA",
    "STANDARD_GRAVITY",
    "A",
    "B",
    "C_en",
    "C_ew",
    "F",
    "M",
    "earth_rate_n",
    "earth_rate_w",
    "ecef_to_geodetic",
    "geodetic_from_ned_offset",
    "geodetic_from_q_ew",
    "geodetic_to_ecef",
    "ned_offset",
    "normal_gravity",
    "normal_gravity_about_axis",
    "normal_gravity_paper",
    "numeric",
    "position_error",
    "q_ew_from_geodetic",
    "radii",
    "transport_rate_about_axis",
    "transport_rate_n",
    "transport_rate_w",
]
