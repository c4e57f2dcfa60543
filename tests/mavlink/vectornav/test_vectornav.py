"""`insenv stream --as`: hosts of a unit on TCP and on a serial line, MAVLink beside it, refused calls."""

import os
import socket
import threading

import numpy as np
import pytest
from command_line import call, refused, strict
from streamed_vehicle import Receiver, free_port
from vectornav_host import INS, commands, read

from insenv.cli.stream import _print_summary

POSIX = pytest.mark.skipif(os.name != "posix", reason="pseudo-terminals of POSIX systems")
DRIVER = [
    "VNASY,0", "VNWRG,06,0,1", "VNWRG,06,0,2", "VNRRG,01", "VNWRG,75,3,8,01,0721", "VNWRG,76,3,8,31,0001,0106,0613",
    "VNWRG,77,3,80,49,0003,26B8,0018", "VNASY,1",
]  # fmt: skip
"""What ArduPilot's driver sends to a VN-300 at EAHRS_RATE 50, each after the answer to the one before."""


def play(server, answers, after):
    """Send each command after the answer to the one before, and read what follows the last: the driver on a TCP server."""
    with server.accept()[0] as line:
        line.settimeout(60)
        data = b""
        line.sendall(b"$VNTAR*XX\r\n")
        for command in DRIVER:
            line.sendall(commands(command))
            while (begin := data.find(f"${command}".encode())) < 0 or (end := data.find(b"\r\n", begin)) < 0:
                data += line.recv(4096)
            answers.append(data[begin + 1 : end - 3].decode())
            data = data[end + 2 :]
        while piece := line.recv(4096):
            data += piece
        after.extend(data)


def test_the_driver_of_ardupilot_configures_the_unit_and_reads_it(capsys):
    answers, after = [], bytearray()
    with socket.create_server(("127.0.0.1", 0)) as server:
        thread = threading.Thread(target=play, args=(server, answers, after), daemon=True)
        thread.start()
        to = ("--to", f"tcpout:127.0.0.1:{server.getsockname()[1]}", "--duration", 12, "--speed", 4, "--json")
        status, out, err = call("stream", "car-city-drive", "--as", "vn300", *to)
        thread.join(60)
    found, frames = strict(out), read(bytes(after))
    assert (status, err, found["unit"], len(found["commands_refused"])) == (0, "", "VN-300", 1)
    assert found["received"] == {"VNASY": 2, "VNRRG": 1, "VNWRG": 5, "unknown command": 1}
    _print_summary(found)
    assert "refused command (1): VNTAR: a unit knows VNASY, VNRRG, VNWRG" in capsys.readouterr().out
    assert answers == [f"{text},VN-300" if text == "VNRRG,01" else text for text in DRIVER]
    times = np.array([[frame[0] for frame in frames[header]] for header in ("012107", "31010006011306")])
    assert np.all(np.diff(times) == 20_000_000) and times[0, -1] == 12_000_000_000 and len(frames["490300b8261800"]) > 5
    assert dict(zip(INS, frames["31010006011306"][-1], strict=True))["status"] == 1 | 1 << 2  # aligning, with a fix


@POSIX
def test_a_serial_line_carries_whole_frames_also_to_who_reads_late_and_mavlink_is_beside_it():
    master, slave = os.openpty()
    data = bytearray()  # read after the end: the line has taken what it holds, and the rest was dropped
    try:
        with Receiver() as client:
            addresses = ("--to", f"serial:{os.ttyname(slave)}", "--to", client.to)
            status, out, _ = call("stream", "ship-swaying", "-e", "q-method", "--as", "vn100", *addresses, "--duration", 3,
                                  "--speed", 0, "--json")  # fmt: skip
        os.set_blocking(master, False)
        while True:
            try:
                data += os.read(master, 4096)
            except BlockingIOError:
                break
    finally:
        os.close(master)
        os.close(slave)
    found = strict(out)
    line, mavlink = found["links"]
    assert status == 0 and line["address"].endswith(":921600") and mavlink["dropped_frames"] == 0
    assert {name: n for name, n in found["sent"].items() if "OUTPUT" in name} == {"OUTPUT_75": 600, "OUTPUT_76": 150}
    assert len(client.frames) == sum(found["sent"].values()) - 750 and line["sent_frames"] + line["dropped_frames"] == 750
    frames = read(bytes(data))
    assert 0 < sum(map(len, frames.values())) <= line["sent_frames"] < 750


def test_wrong_calls_are_refused_in_one_sentence():
    with socket.create_server(("127.0.0.1", 0)) as taken:
        address = f"tcpin:127.0.0.1:{taken.getsockname()[1]}"
        refused(call("stream", "car-city-drive", "--as", "vn300", "--to", address), address, "in use")
    to = ("--to", f"tcpin:127.0.0.1:{free_port(socket.SOCK_STREAM)}")
    refused(call("stream", "ship-swaying", "-e", "q-method", "--as", "vn300", *to), "q-method", "aligns in place", "VN-100")
