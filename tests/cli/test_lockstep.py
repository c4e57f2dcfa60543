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
from command_line import call, refused, strict
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
    assert sum(frame[7] == 107 for frame in logged(log)[1]) >= 200  # HIL_SENSOR


@pytest.mark.skipif(os.name != "posix", reason="signals of POSIX systems")
def test_ardupilot_until_a_signal_ends_the_wait_for_it(tmp_path):
    port, times, file = free_port(), [], tmp_path / "good-unit.parm"
    (tmp_path / "mine").write_text("mine")
    address = f"udpin:127.0.0.1:{port}"
    refusing = ("stream", "car-city-drive", "--lockstep", "ardupilot-json", "--to", address, "--write-parameters")
    refused(call(*refusing, tmp_path / "mine"), "exists with another content: it is not overwritten")
    refused(call(*refusing, file, "--tlog", tmp_path / "x.tlog"), "--tlog")
    assert not file.exists()

    def fly():
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as link:
            link.settimeout(0.5)
            link.connect(("127.0.0.1", port))
            while len(times) < 200:
                try:
                    times.append(exchange(link, len(times))["timestamp"])
                except OSError:
                    time.sleep(0.02)
        os.kill(os.getpid(), signal.SIGTERM)

    handler = signal.signal(signal.SIGTERM, signal.default_int_handler)
    try:
        threading.Thread(target=fly, daemon=True).start()
        arguments = ("--lockstep", "ardupilot-json", "--to", address, "--json", "--write-parameters", file)
        status, out, err = call("stream", "car-city-drive", *arguments)
    finally:
        signal.signal(signal.SIGTERM, handler)
    found = strict(out)
    assert (status, err) == (0, "") and found["interrupted"] is True and found["progress"]["steps"] == 200
    np.testing.assert_allclose(times, np.arange(1, 201) * 0.005, atol=1e-9)
    written = file.read_text().splitlines()
    assert {"SIM_DRIFT_SPEED 0", "INS_ACCSCAL_Z 1", "INS_ACC2SCAL_Z 1", "INS_ACC2OFFS_X 1e-05"} <= set(written)


def test_home_as_ardupilot_takes_it():
    car = quiet()
    latitude, longitude, height, heading = map(float, home_option(car).split(","))
    known = car.simulation.plant.knowledge
    assert (latitude, longitude) == pytest.approx((math.degrees(known.latitude), math.degrees(known.longitude)), abs=1e-7)
    assert height == pytest.approx(known.height, abs=0.01)
    assert heading == pytest.approx(math.degrees(known.heading) % 360.0, abs=0.06)
