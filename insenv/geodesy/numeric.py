"""The functions of ``insenv.geodesy`` for NumPy arrays, broadcasting over leading axes."""

from insenv.core.numeric import vectorized
from insenv.geodesy import frames, position, wgs84

radii = vectorized(wgs84.radii, ())
normal_gravity = vectorized(wgs84.normal_gravity, (), ())
normal_gravity_about_axis = vectorized(wgs84.normal_gravity_about_axis, 3, ())
normal_gravity_paper = vectorized(wgs84.normal_gravity_paper, (), ())

earth_rate_n = vectorized(frames.earth_rate_n, ())
transport_rate_n = vectorized(frames.transport_rate_n, 3, (), ())
C_en = vectorized(frames.C_en, (), ())
C_ew = vectorized(frames.C_ew, (), (), ())
q_ew_from_geodetic = vectorized(frames.q_ew_from_geodetic, (), (), ())
geodetic_from_q_ew = vectorized(frames.geodetic_from_q_ew, 4)
transport_rate_w = vectorized(frames.transport_rate_w, 3, 4, ())
earth_rate_w = vectorized(frames.earth_rate_w, 4)

geodetic_to_ecef = vectorized(position.geodetic_to_ecef, (), (), ())
ecef_to_geodetic = vectorized(position.ecef_to_geodetic, 3)
ned_offset = vectorized(position.ned_offset, (), (), (), (), (), ())
geodetic_from_ned_offset = vectorized(position.geodetic_from_ned_offset, 3, (), (), ())
position_error = vectorized(position.position_error, (), (), (), (), (), ())
