"""MAVLink: a simulated vehicle with its estimator, live, for ground stations and autopilots.

`wire` holds links, peers and signing; `messages` what each message says and when it is due; `lockstep` the interfaces
to autopilots.
"""

from insenv.mavlink.simulation import Simulation
from insenv.mavlink.stream import Stream
from insenv.mavlink.vehicle import Vehicle

__all__ = ["Simulation", "Stream", "Vehicle"]
