"""A MAVSDK client as a process of its own: ``mavsdk_client.py URL SECONDS PARAMETER VALUE``.  Prints what it saw as JSON.

Connects, waits for a vehicle, listens to its telemetry for so long, and until all of its health is good (30 s at most), reads
all parameters, sets one and reads it again, and downloads mission, fence and rally points.
"""

import enum
import json
import sys
import threading
import time

from mavsdk import ComponentType, Configuration, Mavsdk
from mavsdk.plugins.info import Info
from mavsdk.plugins.mission_raw import MissionRaw
from mavsdk.plugins.param import Param
from mavsdk.plugins.telemetry import Telemetry

STREAMS = (
    "position", "attitude_quaternion", "velocity_ned", "imu", "ground_truth", "gps_info", "health", "health_all_ok",
    "landed_state",
)  # fmt: skip


def flat(value):
    """A MAVSDK value as JSON: objects become dicts of what they hold."""
    if isinstance(value, enum.Enum):
        return value.name
    if hasattr(value, "__dict__"):
        return {name: flat(item) for name, item in vars(value).items() if not name.startswith("_")}
    return [flat(item) for item in value] if isinstance(value, (list, tuple)) else value


def main(url, seconds, parameter, value):
    seen, lock = {name: [] for name in STREAMS}, threading.Lock()
    sdk = Mavsdk(Configuration.create_with_component_type(ComponentType.GROUND_STATION))
    sdk.add_any_connection(url)
    system = sdk.first_autopilot(timeout_s=30.0)
    if system is None:
        sys.exit("no vehicle found")
    telemetry, begun = Telemetry(system), time.monotonic()

    def keep(name):
        def callback(data, _):
            with lock:
                seen[name].append(flat(data))

        return callback

    for name in STREAMS:
        getattr(telemetry, f"subscribe_{name}")(keep(name))
    parameters, missions = Param(system), MissionRaw(system)
    every, before = flat(parameters.get_all_params()), parameters.get_param_float(parameter)
    parameters.set_param_float(parameter, value)
    kinds = [flat(system.vehicle_type()), flat(system.autopilot_type())]
    found = {
        "system": [system.get_system_id(), system.component_ids(), *kinds],
        "parameters": every,
        "set": [before, parameters.get_param_float(parameter)],
        "version": flat(Info(system).get_version()),
        "downloads": [
            flat(get()) for get in (missions.download_mission, missions.download_geofence, missions.download_rallypoints)
        ],
    }

    def healthy():
        return True in seen["health_all_ok"][-1:] and all(all(health.values()) for health in seen["health"][-1:])

    while (now := time.monotonic() - begun) < seconds or (now < 30.0 and not healthy()):
        time.sleep(0.05)
    with lock:
        print(json.dumps(found | {"seen": seen}), flush=True)
    sdk.destroy()


if __name__ == "__main__":
    main(sys.argv[1], float(sys.argv[2]), sys.argv[3], float(sys.argv[4]))
