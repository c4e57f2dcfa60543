"""`insenv stream --lockstep`: a stand-in for the autopilot answers each step once."""

import math
import os
import signal
import socket
import threading
import time

import numpy as np
import pytest
from autopilots import Px4StandIn, exchange
from command_line import call, strict
from streamed_vehicle import free_port, logged, quiet

from insenv.cli.lockstep import home_option


def test_px4(tmp_path):
    log, px4 = tmp_path / "px4.tlog", Px4StandIn(free_port(socket.SOCK_STREAM))
    to = ("--to", f"tcpin:127.0.0.1:{px4.port}", "--speed", 10, "--duration", "1", "--tlog", log)
    status, out, err = call("stream", "car-city-drive", "--lockstep", "px4", *to, "--json")
    px4.done()
    found = strict(out)
    assert (status, err) == (0, "") and found["simulated_s"] == pytest.approx(1.0) and found["progress"]["steps"] == 200
    assert px4.times == [5000 * k for k in range(1, 201)]
    _, frames = logged(log)
    assert sum(frame[7] == 107 for frame in frames) >= 200  # HIL_SENSOR


class ArduPilot(threading.Thread):
    """Sends frames, in the rhythm of the answers; kills this process softly after so many of them."""

    def __init__(self, end_after=None):
        super().__init__(daemon=True)
        self.port, self.end_after, self.times, self.ended = free_port(), end_after, [], False
        self.start()

    def run(self):
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as link:
            link.settimeout(0.5)
            link.connect(("127.0.0.1", self.port))
            while not self.ended:
                try:
                    self.times.append(exchange(link, len(self.times))["timestamp"])
                except OSError:
                    time.sleep(0.02)
                if len(self.times) == self.end_after:
                    os.kill(os.getpid(), signal.SIGTERM)
                    return

    def flown(self, *arguments):
        try:
            to = f"udpin:127.0.0.1:{self.port}"
            return call("stream", "car-city-drive", "--lockstep", "ardupilot-json", "--to", to, *arguments)
        finally:
            self.ended = True
            self.join(10)


def test_ardupilot():
    ardupilot = ArduPilot()
    status, out, err = ardupilot.flown("--duration", "1")
    assert (status, err) == (0, "") and "1.0 s simulated in lockstep with ardupilot-json" in out and "steps 200" in out
    np.testing.assert_allclose(np.diff(np.unique(ardupilot.times)), 0.005, atol=1e-9)  # a repeated request: the same answer
    assert ardupilot.times[-1] in (pytest.approx(1.0), pytest.approx(0.995))  # the last answer may come after the end


@pytest.mark.skipif(os.name != "posix", reason="signals of POSIX systems")
def test_a_lockstep_that_waits_for_its_autopilot_is_ended_by_a_signal():
    handler = signal.signal(signal.SIGTERM, signal.default_int_handler)
    try:
        status, out, err = ArduPilot(end_after=3).flown("--json")
    finally:
        signal.signal(signal.SIGTERM, handler)
    found = strict(out)
    assert (status, err) == (0, "") and found["interrupted"] is True and found["progress"]["steps"] == 3


def test_home_as_ardupilot_takes_it():
    car = quiet()
    latitude, longitude, height, heading = map(float, home_option(car).split(","))
    known = car.simulation.plant.knowledge
    assert (latitude, longitude) == pytest.approx((math.degrees(known.latitude), math.degrees(known.longitude)), abs=1e-7)
    assert height == pytest.approx(known.height, abs=0.01)
    assert heading == pytest.approx(math.degrees(known.heading) % 360.0, abs=0.06)
