"""A filter behind a port: here a program of this machine, on a socket or a serial line, or the Cortex-M7 of qemu."""

import contextlib
import io
import os
import socket
import subprocess
import threading
import time
from types import SimpleNamespace

import numpy as np
import pytest
from command_line import call, strict
from peers import program

from insenv.base.errors import InputError, InsenvError
from insenv.export.board import check, check_c, export_c
from insenv.export.board.exporter import RUN
from insenv.export.board.figures import COMPILER, INSTALL, QEMU


@pytest.fixture(scope="module")
def exported(tmp_path_factory):
    folder = export_c("q-method", output=tmp_path_factory.mktemp("check"), measure=False).folder
    subprocess.run([program("make", how="apt-get install make"), "-s", "-C", folder, "CFLAGS=-O0", "port"], check=True)
    return folder


@contextlib.contextmanager
def served(*command):
    """The port of a program whose standard streams are a connection."""
    with socket.create_server(("127.0.0.1", 0)) as server:

        def serve():
            connection, _ = server.accept()
            with connection:
                subprocess.run(command, stdin=connection, stdout=connection)

        thread = threading.Thread(target=serve)
        thread.start()
        yield f"tcp:127.0.0.1:{server.getsockname()[1]}"
        thread.join()


def test_a_filter_behind_a_port_has_the_same_bits(exported):
    with served(exported / "build" / "port") as port:
        status, out, _ = call("check", "c", exported, "--port", port)
        assert (status, out) == (0, f"{port}: 300 samples, 248 numbers compared, 0 differ\n")


def test_a_status_and_its_outputs_leave_in_one_packet(exported):
    """The second of two would wait until the first is acknowledged, about 40 ms."""
    here, board = socket.socketpair(socket.AF_UNIX, socket.SOCK_DGRAM)
    with here, board, subprocess.Popen([exported / "build" / "port"], stdin=subprocess.PIPE, stdout=board) as running:
        running.communicate(b"SO")
        assert [here.recv(1000) for _ in range(2)] == [b"\0" + check._Export(exported).at_start.tobytes()] * 2


@pytest.mark.parametrize(("rate", "speed"), [("", 115_200), (":921600", 921_600)])
def test_a_filter_behind_a_serial_line_has_the_same_bits(exported, rate, speed):
    """The numbers have bytes that a terminal takes for line ends, interrupts and the end of a file."""
    termios = pytest.importorskip("termios", reason="a pseudo-terminal stands for the serial line: not on Windows")
    board, line = os.openpty()
    with subprocess.Popen([exported / "build" / "port"], stdin=board, stdout=board) as running:
        found = check_c(exported, f"serial:{os.ttyname(line)}{rate}")
        set_to = termios.tcgetattr(line)[5]
        os.close(line)  # which ends the program
        assert running.wait(10) == 0
    os.close(board)
    assert (found.samples, found.compared, found.differing) == (300, 248, 0)
    assert set_to == getattr(termios, f"B{speed}")


def test_a_check_after_one_that_was_cut_finds_its_place(exported):
    """In the middle of the inputs of a sample, with outputs that nobody has read."""
    cut = b"SO" + b"I" + bytes(11)
    octal = "".join(f"\\{byte:03o}" for byte in cut)
    script = f"{{ printf '{octal}'; cat; }} | {exported / 'build' / 'port'}"
    with served("sh", "-c", script) as port:
        found = check_c(exported, port)
    assert (found.samples, found.compared, found.differing) == (300, 248, 0)


def test_another_bit_is_found_and_ends_with_status_1(exported, tmp_path):
    (tmp_path / "test").mkdir()
    text = (exported / "test" / "samples.h").read_text()
    head, _, rest = text.rpartition("  {")  # the outputs after 300 samples
    number, _, rest = rest.partition(",")
    (tmp_path / "test" / "samples.h").write_text(f"{head}  {{{float(number) + 2e-16!r},{rest}")
    with served(exported / "build" / "port") as port:
        status, out, _ = call("check", "c", tmp_path, "--port", port, "--json")
        told = strict(out)
    assert (status, told["differing"], told["first"][:3]) == (1, 1, [300, 0, float(number)])


def test_a_whole_run_is_read_in_records_and_a_port_to_the_byte(tmp_path):
    """Three samples of two inputs, then two outputs; a port that gives two bytes at a time has more to give than is asked."""
    (tmp_path / "test").mkdir()
    text = ["#define EVERY 1", "#define RUN_EVERY 3", "outputs_at_start[2] = {0.5, 0.5};"]
    text += [f"first_{what}[1][2] = {{\n  {{0.0, 0.0}},\n}};" for what in ("inputs", "outputs")]
    (tmp_path / "test" / "samples.h").write_text("\n".join([*text, ""]))
    numbers = np.arange(16.0).reshape(2, 4, 2)
    for size in (0, 7):
        numbers.ravel()[:size].tofile(tmp_path / RUN)
        with pytest.raises(InputError, match=rf"run.bin has {8 * size} bytes: allowed is a multiple of 64"):
            check._Export(tmp_path)
    numbers.tofile(tmp_path / RUN)
    export = check._Export(tmp_path)
    given, known = zip(*export.rows(), strict=True)
    assert export.samples == 6 and np.array_equal(np.frombuffer(b"".join(given)).reshape(2, 3, 2), numbers[:, :3])
    assert [None if row is None else row.tolist() for row in known] == [None, None, [6.0, 7.0], None, None, [14.0, 15.0]]
    stream = io.BytesIO(bytes(range(9)))
    port = SimpleNamespace(read=lambda count: stream.read(min(count, 2)))
    assert [check._read(port, size) for size in (3, 1, 4)] == [bytes(range(3)), b"\3", bytes(range(4, 8))]


def test_a_board_that_refuses_or_is_silent_and_a_wrong_port_are_errors(exported, monkeypatch):
    size = check._Export(exported).inputs.shape[1] * 8 + 1  # zeros, and the H of a greeting
    for answer, told in (
        ("\\006", "start: the filter answers with status 6"),
        ("\\007", "another program than test/port.c answers"),
    ):
        board = served("sh", "-c", f"head -c {size} >&2; head -c 8; printf '{answer}'")
        with board as port, pytest.raises(InsenvError, match=told):
            check_c(exported, port)
    monkeypatch.setattr(check, "LEFT_OVER", 100)
    with served("yes") as port, pytest.raises(InsenvError, match=r"another program than test/port\.c of this export sends"):
        check_c(exported, port)
    with served("true") as port, pytest.raises(InsenvError, match="the port was closed"):
        check_c(exported, port)
    monkeypatch.setattr(check, "TIMEOUT_S", 0.05)
    with served("sleep", "0.2") as port, pytest.raises(InsenvError, match=r"no answer within 0\.05 s"):
        check_c(exported, port)
    for wrong in ("usb:3", "tcp:localhost:0", "tcp:localhost:65536"):
        with pytest.raises(InputError, match=rf"port '{wrong}': allowed is tcp:HOST:PORT with a PORT from 1 to 65535"):
            check_c(exported, wrong)
    with pytest.raises(InputError, match=r"port 'serial:/dev/none' cannot be opened: .*No such file or directory: '/dev/none'"):
        check_c(exported, "serial:/dev/none")


@pytest.mark.slow
def test_the_serial_line_of_a_cortex_m7(tmp_path):
    for name in (COMPILER, QEMU):
        program(name, how=INSTALL)
    export_c("loosely-coupled", output=tmp_path, measure=False)
    with socket.create_server(("127.0.0.1", 0)) as free:
        number = free.getsockname()[1]
    board = subprocess.Popen(["make", "-s", "-C", tmp_path, "board-port", f"PORT={number}"], start_new_session=True)
    try:
        for _ in range(100):
            with contextlib.suppress(InputError):
                found = check_c(tmp_path, f"tcp:127.0.0.1:{number}", samples=50)
                break
            time.sleep(0.5)
    finally:
        subprocess.run(["kill", "--", f"-{board.pid}"], check=True)
        board.wait()
    assert (found.samples, found.compared, found.differing) == (50, 6 * 66, 0)
