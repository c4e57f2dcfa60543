"""`insenv stream`: its summary and log, its ends, its dashboard, wrong calls."""

import io
import json
import os
import re
import signal
import socket
import threading
from collections import Counter
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from command_line import call, refused, strict
from pymavlink.dialects.v20 import common
from rich.console import Console
from scipy.spatial.transform import Rotation
from streamed_vehicle import Receiver, decoded, estimate, frame_of, logged, lost, quiet, wait_for

from insenv.cli.signals import Ending
from insenv.cli.stream import Rates, dashboard, picture
from insenv.mavlink import Stream, Vehicle
from insenv.mavlink.score import Score
from insenv.mavlink.wire import Signing, open_link
from insenv.mavlink.wire.signing import Verdict
from insenv.scenario import load

POSIX = pytest.mark.skipif(os.name != "posix", reason="signals and terminals of POSIX systems")


def test_one_document_and_a_log_of_all_that_was_sent(tmp_path):
    log = tmp_path / "flight.tlog"
    with Receiver() as client:
        arguments = ("--to", client.to, "--speed", 0, "--duration", 3, "--tlog", log, "--json")
        status, out, err = call("stream", "car-city-drive", *arguments, "--rate", "ATTITUDE=50", "--rate", "ALTITUDE=0")
    found = strict(out)
    assert (status, err) == (0, "") and found["simulated_s"] == pytest.approx(3.0) and found["tlog"] == str(log)
    assert found["sent"]["ATTITUDE"] == 150 and found["sent"]["HIL_SENSOR"] == 600 and "ALTITUDE" not in found["sent"]
    assert not found["saturated"] and not found["refused"] and found["link"]["dropped_frames"] == 0
    total = sum(found["sent"].values())
    assert len(client.frames) == total and lost(client.frames) == 0
    sensors = [message.time_usec for message in client.messages() if message.get_type() == "HIL_SENSOR"]
    assert sensors == [5000 * k for k in range(1, 601)]  # the simulation's clock, without gap or repetition
    parameters, frames = logged(log)
    assert Counter(message.get_type() for message in decoded(b"".join(frames))) == found["sent"]
    assert {message.get_type() for message in decoded(b"".join(parameters))} == {"PARAM_VALUE"} and len(parameters) > 50
    assert lost([*parameters, *frames]) == 0
    status, text, said = call("replay", log, "-e", "loosely-coupled")
    assert status == 0 and "is that of the magnetometer" in " ".join(text.split()), said


def test_several_addresses_are_several_links_that_sign_with_numbers_of_their_own(tmp_path):
    """A tool with the same key accepts everything, one with another key nothing."""
    key_file, key = tmp_path / "key", bytes(range(32))
    key_file.write_bytes(key)
    key_file.chmod(0o600)
    with Receiver() as first, Receiver() as second:
        arguments = ("--to", first.to, "--to", second.to, "--speed", 0, "--duration", 2, "--tlog", tmp_path / "a.tlog")
        status, out, err = call("stream", "ship-swaying", *arguments, "--signing-key-file", key_file, "--json")
    found = strict(out)
    total = sum(found["sent"].values())
    assert (status, err) == (0, "") and [link["address"] for link in found["links"]] == [first.to, second.to]
    assert len(first.frames) == len(second.frames) == total == len(logged(tmp_path / "a.tlog")[1]) > 200
    assert lost(first.frames) == lost(second.frames) == 0 and found["link"]["sent_frames"] == 2 * total
    assert found["link"]["sent_messages"] == total
    for number, frames in enumerate((first.frames, second.frames)):
        assert {frame[-13] for frame in frames} == {number}
        assert all(a < b for a, b in pairwise(int.from_bytes(frame[-12:-6], "little") for frame in frames))
        for tool, verdict in ((Signing(key), Verdict.GOOD), (Signing(bytes(range(1, 33))), Verdict.WRONGLY_SIGNED)):
            assert {tool.verify(frame) for frame in frames} == {verdict}


def test_a_vehicle_has_a_system_of_its_own_and_tells_its_errors():
    with Receiver() as client:
        status, *_ = call("stream", "ship-swaying", "--to", client.to, "--speed", 0, "--duration", 2, "--system", 7, "--errors")
    assert status == 0 and {frame[5] for frame in client.frames} == {7}
    assert {m.name for m in client.messages() if m.get_type() == "NAMED_VALUE_FLOAT"} == {"ERR_TILT", "ERR_HDG"}


@pytest.mark.slow
def test_a_score_is_written_as_a_run_is(tmp_path):
    """A client answers the truth with a heading that is 1.5 deg off."""
    out, ended = tmp_path / "score", threading.Event()
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as client:
        client.bind(("127.0.0.1", 0))
        client.settimeout(0.1)

        def answer():
            reader = common.MAVLink(None)
            while not ended.is_set():
                try:
                    data, vehicle = client.recvfrom(2048)
                except TimeoutError:
                    continue
                message = reader.decode(bytearray(data))
                if message.get_type() == "HIL_STATE_QUATERNION":
                    heading = Rotation.from_euler("z", 1.5, degrees=True)
                    turned = heading * Rotation.from_quat(message.attitude_quaternion, scalar_first=True)
                    made = estimate("ODOMETRY", time_usec=message.time_usec, q=turned.as_quat(scalar_first=True))
                    client.sendto(frame_of(made, system=42, component=191), vehicle)

        thread = threading.Thread(target=answer, daemon=True)
        thread.start()
        to = ("--to", f"udpout:127.0.0.1:{client.getsockname()[1]}", "--score", "--speed", 4)
        status, text, _ = call("stream", "car-city-drive", *to, "--duration", 2, "--out", out, "--json")
        ended.set()
        thread.join()
    score = json.loads(text)["score"]
    (result,) = score["results"]
    assert status == 0 and result["estimator"] == "odometry-42-191"
    assert result["final"]["heading_deg"] == pytest.approx(1.5, abs=1e-3) and result["limit"]["heading_deg"] > 0.0
    assert {Path(path).suffix for path in score["files"]} == {".npz", ".json", ".html", ".png", ".svg"}
    with np.load(out / "car-city-drive.npz") as arrays:
        np.testing.assert_allclose(arrays["odometry-42-191/errors/heading_deg"], 1.5, atol=1e-3)


@POSIX
@pytest.mark.parametrize("name, ignored", [("SIGINT", False), ("SIGINT", True), ("SIGTERM", False), ("SIGHUP", False)])
def test_every_request_to_end_completes_log_and_summary(name, ignored, tmp_path):
    """SIGINT counts also where it is ignored, as in the background jobs of a script."""
    number = getattr(signal, name)
    handler = signal.signal(number, signal.SIG_IGN if ignored else signal.default_int_handler)
    try:
        with Receiver() as client:

            def end():
                wait_for(lambda: len(client.frames) > 50)
                os.kill(os.getpid(), number)

            thread = threading.Thread(target=end, daemon=True)
            thread.start()
            status, out, err = call("stream", "ship-swaying", "--to", client.to, "--tlog", tmp_path / "a.tlog", "--json")
            thread.join()
    finally:
        signal.signal(number, handler)
    summary = strict(out)
    assert (status, err) == (0, "") and summary["interrupted"] is True and summary["scenario"] == "ship-swaying"
    assert len(logged(tmp_path / "a.tlog")[1]) == sum(summary["sent"].values()) == len(client.frames)
    assert not list(tmp_path.glob("*.part"))


def test_dashboard_shows_rates_lateness_clients_errors_and_alignment():
    vehicle, rates = Vehicle(load("ship-swaying"), speed=0.0), Rates()
    vehicle.score = Score(vehicle.view)
    with Receiver() as client, open_link(client.to) as link:
        stream = Stream(vehicle, link)
        picture(stream, rates, now=0.0)
        stream.run(5.0)
        vehicle.score.take(estimate("ATTITUDE", time_boot_ms=4000, yaw=1.0))
        total = link.statistics.sent_frames
        console = Console(width=40, record=True, file=io.StringIO())
        console.print(picture(stream, rates, now=5.0, width=40))
        text = console.export_text()
    for name, count in stream.sent.items():  # no column is lost
        assert re.search(rf"{name[:20]} +{count / 5:.1f}", text), name
    flat = " ".join(text.split())
    words = ("lateness", client.to, "aligning", "attitude-42-191", f"{total} sent to 1 client")
    assert all(word in flat for word in words)
    assert re.search(r"error +tilt \S+ deg, heading \S+ deg", flat) and max(map(len, text.splitlines())) <= 40


class Terminal(io.StringIO):
    """A terminal that can be closed."""

    gone = False

    def isatty(self):
        return True

    def write(self, text):
        if self.gone:
            raise OSError(5, "Input/output error")
        return super().write(text)


def test_the_dashboard_of_a_closed_terminal_requests_the_end(monkeypatch):
    monkeypatch.setattr("sys.stderr", terminal := Terminal())
    request = Ending()
    with open_link("udpin:127.0.0.1:0") as link, dashboard(Stream(quiet("ship-swaying"), link), request) as show:
        show(Stream(quiet("ship-swaying"), link))
        assert "Ctrl-C ends the stream" in terminal.getvalue() and not request()
        terminal.gone = True
        show(Stream(quiet("ship-swaying"), link))
    assert request()


def test_a_log_that_cannot_be_written_is_refused_before_the_stream(tmp_path):
    for path, word in ((tmp_path, "folder"), (os.devnull, "not a regular file"), (tmp_path / "no" / "a", "does not exist")):
        refused(call("stream", "car-city-drive", "--to", "udpout:127.0.0.1:9", "--tlog", path), word)
    assert not list(tmp_path.iterdir())
