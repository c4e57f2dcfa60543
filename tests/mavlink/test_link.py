"""Links: datagrams and streams, peers that come and go, and invalid input of every kind."""

from __future__ import annotations

import itertools
import os
import random
import socket
import struct
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, suppress
from typing import Any

import pytest

from insenv.errors import InputError
from insenv.mavlink.wire import Link, Statistics, dialect, open_link, parse_address
from insenv.mavlink.wire.datagrams import EXPIRY_S, LARGEST, MOST_PEERS, MOST_STRANGERS
from insenv.mavlink.wire.frames import LONGEST, split
from insenv.mavlink.wire.link import MESSAGES_PER_CALL
from insenv.mavlink.wire.peers import INBOX_BYTES, OUTBOX_BYTES
from insenv.mavlink.wire.streams import MOST_CLIENTS, STALLED_S

m = dialect()


class Clock:
    """A clock that the test advances."""

    def __init__(self) -> None:
        self.now = 100.0

    def __call__(self) -> float:
        return self.now


@pytest.fixture
def sockets() -> Iterator[Callable[..., socket.socket]]:
    """Plain sockets on loopback, closed at the end."""
    with ExitStack() as stack:

        def make(kind: socket.SocketKind = socket.SOCK_DGRAM) -> socket.socket:
            made = stack.enter_context(socket.socket(socket.AF_INET, kind))
            made.settimeout(5)
            return made

        yield make


def heartbeat() -> Any:
    return m.MAVLink_heartbeat_message(m.MAV_TYPE_GCS, m.MAV_AUTOPILOT_INVALID, 0, 0, m.MAV_STATE_ACTIVE, 3)


def frame_of(message: Any, sequence: int = 0, system: int = 255, component: int = 190) -> bytes:
    packer = m.MAVLink(None, srcSystem=system, srcComponent=component)
    packer.seq = sequence
    return message.pack(packer)


def until(link: Link, enough: Callable[[list[Any]], bool], tries: int = 2000) -> list[Any]:
    """What `link` receives until `enough`; loopback delivers at once, TCP a little later."""
    got: list[Any] = []
    for _ in range(tries):
        got += link.receive()
        if enough(got):
            return got
        time.sleep(0.001)
    raise AssertionError(f"not enough: {got}, {link.statistics}")


def decoded(data: bytes) -> list[Any]:
    """All messages in a stream of bytes, by pymavlink's own parser."""
    parser = m.MAVLink(None)
    parser.robust_parsing = True
    return parser.parse_buffer(data) or []


# --- addresses -----------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("text", "wanted"),
    [
        ("udpout:10.0.0.2:14550", ("udpout", "10.0.0.2", 14550)),
        ("udpin::14550", ("udpin", "127.0.0.1", 14550)),
        ("udpin:14550", ("udpin", "127.0.0.1", 14550)),
        ("tcpin:0.0.0.0:0", ("tcpin", "0.0.0.0", 0)),
        ("tcpout:[::1]:5760", ("tcpout", "::1", 5760)),
        ("serial:/dev/ttyUSB0:115200", ("serial", "/dev/ttyUSB0", 115200)),
        ("serial:/dev/ttyUSB0", ("serial", "/dev/ttyUSB0", 57600)),
        ("serial:COM3:921600", ("serial", "COM3", 921600)),
    ],
)
def test_addresses(text: str, wanted: tuple[str, str, int]) -> None:
    address = parse_address(text)
    assert (address.kind, address.host, address.port) == wanted
    assert parse_address(str(address)) == address


@pytest.mark.parametrize(
    "text",
    [
        "",
        "udp:1:2",
        "udpout:127.0.0.1:0",
        "udpout:h:65536",
        "udpin:h:x",
        "udpin:::1:5",
        "serial:",
        "serial:/dev/x:0",
        "udpout:h:-1",
    ],
)
def test_errors_of_wrong_addresses_name_what_is_allowed(text: str) -> None:
    with pytest.raises(InputError, match=r"address .*(must be|written in brackets)"):
        parse_address(text)


def test_links_that_cannot_be_opened_are_errors(opened: Callable[..., Link]) -> None:
    taken = opened("udpin:127.0.0.1:0")
    with pytest.raises(InputError, match=str(taken.address.port)):
        open_link(f"udpin:127.0.0.1:{taken.address.port}")
    with pytest.raises(InputError, match="host"):
        open_link("udpout:no.such.host.invalid:14550")
    with pytest.raises(InputError, match=r"192\.0\.2\.1"):
        open_link("tcpin:192.0.2.1:5760")  # not an address of this machine
    with pytest.raises(InputError, match="system 0: allowed is 1 to 255"):
        open_link("udpin:127.0.0.1:0", system=0)


# --- UDP -----------------------------------------------------------------------------------------


def test_udp_in_both_directions(opened: Callable[..., Link]) -> None:
    vehicle = opened("udpin:127.0.0.1:0")
    ground = opened(f"udpout:127.0.0.1:{vehicle.address.port}", system=255, component=190)
    assert vehicle.peers == () and len(ground.peers) == 1
    vehicle.send(heartbeat())  # without a peer
    frame = ground.send(m.MAVLink_ping_message(7, 1, 0, 0))
    assert frame[0] == 0xFD and frame[4:7] == bytes((0, 255, 190))
    ((peer, ping),) = until(vehicle, bool)
    assert ping.get_type() == "PING" and ping.time_usec == 7 and (ping.get_srcSystem(), ping.get_srcComponent()) == (255, 190)
    assert vehicle.peers == (peer,) and (peer.system, peer.component, peer.received) == (255, 190, 1)
    vehicle.send(heartbeat())
    vehicle.send_to(peer, m.MAVLink_ping_message(7, 1, 255, 190))
    back = [message for _, message in until(ground, lambda got: len(got) == 2)]
    assert [message.get_type() for message in back] == ["HEARTBEAT", "PING"]
    assert back[1].get_seq() == back[0].get_seq() + 1


def test_each_peer_and_the_log_have_consecutive_sequence_numbers(opened: Callable[..., Link]) -> None:
    vehicle = opened("udpin:127.0.0.1:0")
    grounds = [opened(f"udpout:127.0.0.1:{vehicle.address.port}", system=250 + i) for i in range(3)]
    logged = []
    for round_ in range(100):
        for ground in grounds[: 1 + round_ // 30]:  # one after another
            ground.send(heartbeat())
        until(vehicle, lambda got: len({peer for peer, _ in got}) == min(1 + round_ // 30, 3))  # noqa: B023
        logged += [vehicle.send(heartbeat()) for _ in range(3)]
        for peer in vehicle.peers[round_ % len(vehicle.peers) :]:
            logged.append(vehicle.send_to(peer, m.MAVLink_ping_message(round_, 0, 0, 0)))
    assert [frame[4] for frame in logged] == [i % 256 for i in range(len(logged))]
    for ground, peer in zip(grounds, vehicle.peers, strict=True):
        numbers = [message.get_seq() for _, message in until(ground, lambda got: len(got) == peer.sent)]  # noqa: B023
        assert [(b - a) % 256 for a, b in itertools.pairwise(numbers)] == [1] * (len(numbers) - 1)


def test_udpout_survives_a_client_that_comes_and_goes(opened: Callable[..., Link], sockets: Callable[..., Any]) -> None:
    first = sockets()
    first.bind(("127.0.0.1", 0))
    port = first.getsockname()[1]
    vehicle = opened(f"udpout:127.0.0.1:{port}")
    for _ in range(5):
        vehicle.send(heartbeat())
    first.close()
    for _ in range(20):  # the system reports that nobody listens, which has no effect
        vehicle.send(heartbeat())
        assert vehicle.receive() == []
    again = sockets()
    again.bind(("127.0.0.1", port))
    for _ in range(10):
        vehicle.send(heartbeat())
    assert [decoded(again.recv(300))[0].get_seq() for _ in range(10)] == list(range(25, 35))


def test_udpout_receives_from_its_peer_only(opened: Callable[..., Link], sockets: Callable[..., Any]) -> None:
    ground = sockets()
    ground.bind(("127.0.0.1", 0))
    vehicle = opened(f"udpout:127.0.0.1:{ground.getsockname()[1]}")
    vehicle.send(heartbeat())
    _, source = ground.recvfrom(300)
    assert source[0] == "127.0.0.1"
    sockets().sendto(frame_of(heartbeat()), source)
    ground.sendto(frame_of(heartbeat(), sequence=9), source)
    assert [message.get_seq() for _, message in until(vehicle, bool)] == [9]


def test_peers_expire_and_come_back(opened: Callable[..., Link]) -> None:
    clock = Clock()
    vehicle = opened("udpin:127.0.0.1:0", clock=clock)
    ground = opened(f"udpout:127.0.0.1:{vehicle.address.port}", system=255)
    ground.send(heartbeat())
    until(vehicle, bool)
    clock.now += EXPIRY_S - 1
    assert vehicle.receive() == [] and len(vehicle.peers) == 1
    clock.now += 2
    assert vehicle.receive() == [] and vehicle.peers == ()
    ground.send(heartbeat())
    until(vehicle, bool)
    assert len(vehicle.peers) == 1


def test_numbers_of_peers_and_strangers_are_limited_and_present_peers_stay(
    opened: Callable[..., Link], sockets: Callable[..., Any]
) -> None:
    vehicle = opened("udpin:127.0.0.1:0")
    target = ("127.0.0.1", vehicle.address.port)
    clients = [sockets() for _ in range(MOST_PEERS + 3)]
    for client in clients:
        client.sendto(frame_of(heartbeat()), target)
        until(vehicle, bool)  # all are answered
    assert len(vehicle.peers) == MOST_PEERS and vehicle.statistics.refused_peers == 3
    there = vehicle.peers
    for _ in range(3 * MOST_STRANGERS):
        sockets().sendto(b"\xfdgarbage", target)
        vehicle.receive()
    assert vehicle.peers == there
    assert len(vehicle._peers) <= MOST_PEERS + MOST_STRANGERS
    clients[0].sendto(frame_of(heartbeat()), target)
    assert until(vehicle, bool)[0][0] is there[0]


def test_a_sender_of_invalid_bytes_gets_nothing(opened: Callable[..., Link], sockets: Callable[..., Any]) -> None:
    vehicle = opened("udpin:127.0.0.1:0")
    stranger = sockets()
    broken = bytearray(frame_of(heartbeat()))
    broken[-1] ^= 1
    for piece in (b"", b"hello", bytes(broken), bytes(300)):
        stranger.sendto(piece, ("127.0.0.1", vehicle.address.port))
    time.sleep(0.02)
    assert vehicle.receive() == [] and vehicle.peers == ()
    assert vehicle.statistics.wrong_checksum == 1


def test_a_truncated_datagram_affects_neither_the_next_nor_another_peer(
    opened: Callable[..., Link], sockets: Callable[..., Any]
) -> None:
    vehicle = opened("udpin:127.0.0.1:0")
    target = ("127.0.0.1", vehicle.address.port)
    one, other = sockets(), sockets()
    whole = frame_of(m.MAVLink_ping_message(2**60, 5, 6, 7))
    for cut in range(1, len(whole)):
        one.sendto(whole[:cut], target)
        other.sendto(whole[cut:], target)
        one.sendto(frame_of(heartbeat()), target)
        other.sendto(frame_of(heartbeat()) + frame_of(heartbeat(), 1), target)
        assert len(until(vehicle, lambda got: len(got) == 3)) == 3
    assert vehicle.statistics.received_messages == 3 * (len(whole) - 1)


def test_our_own_frames_are_not_commands(opened: Callable[..., Link], sockets: Callable[..., Any]) -> None:
    vehicle = opened("udpin:127.0.0.1:0", system=3, component=1)
    sockets().sendto(frame_of(heartbeat(), 0, 3, 1) + frame_of(heartbeat(), 1, 3, 2), ("127.0.0.1", vehicle.address.port))
    assert [message.get_seq() for _, message in until(vehicle, bool)] == [1]
    assert vehicle.statistics.reflected == 1


# --- TCP -----------------------------------------------------------------------------------------


def test_tcp_frames_split_into_single_bytes(opened: Callable[..., Link], sockets: Callable[..., Any]) -> None:
    vehicle = opened("tcpin:127.0.0.1:0")
    client = sockets(socket.SOCK_STREAM)
    client.connect(("127.0.0.1", vehicle.address.port))
    client.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
    data = b"".join(frame_of(m.MAVLink_ping_message(i, i, 0, 0), i) for i in range(4))
    got = []
    for byte in data:
        client.send(bytes((byte,)))
        got += vehicle.receive()
    got += until(vehicle, lambda more: len(got) + len(more) == 4)
    assert [message.time_usec for _, message in got] == [0, 1, 2, 3]
    assert vehicle.statistics.skipped_bytes == 0


def test_tcp_loses_one_frame_to_a_lost_byte(opened: Callable[..., Link], sockets: Callable[..., Any]) -> None:
    vehicle = opened("tcpin:127.0.0.1:0")
    client = sockets(socket.SOCK_STREAM)
    client.connect(("127.0.0.1", vehicle.address.port))
    frames = [frame_of(m.MAVLink_ping_message(i, i, 0, 0), i) for i in range(40)]
    frames[20] = frames[20][:7] + frames[20][8:]
    client.sendall(b"\x00\xfd\xfe" + b"".join(frames))
    got = until(vehicle, lambda got: got and got[-1][1].time_usec == 39)
    assert [message.time_usec for _, message in got] == [i for i in range(40) if i != 20]


def test_tcp_clients_come_and_go(opened: Callable[..., Link], sockets: Callable[..., Any]) -> None:
    vehicle = opened("tcpin:127.0.0.1:0")
    for _ in range(3):
        client = sockets(socket.SOCK_STREAM)
        client.connect(("127.0.0.1", vehicle.address.port))
        client.sendall(frame_of(heartbeat()))
        until(vehicle, bool)
        assert len(vehicle.peers) == 1
        vehicle.send(heartbeat())
        assert decoded(client.recv(300))[0].get_type() == "HEARTBEAT"
        # a reset instead of an orderly close
        client.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))
        client.close()
        for _ in range(500):
            vehicle.send(heartbeat())
            if vehicle.receive() == [] and not vehicle.peers:
                break
            time.sleep(0.001)
        assert vehicle.peers == ()


def test_the_number_of_tcp_clients_is_limited(opened: Callable[..., Link], sockets: Callable[..., Any]) -> None:
    vehicle = opened("tcpin:127.0.0.1:0")
    for _ in range(MOST_CLIENTS + 2):
        sockets(socket.SOCK_STREAM).connect(("127.0.0.1", vehicle.address.port))
        vehicle.receive()
    for _ in range(100):
        vehicle.receive()
    assert len(vehicle.peers) == MOST_CLIENTS and vehicle.statistics.refused_peers == 2


def test_a_tcp_client_that_does_not_read_delays_no_other(opened: Callable[..., Link], sockets: Callable[..., Any]) -> None:
    clock = Clock()
    vehicle = opened("tcpin:127.0.0.1:0", clock=clock)
    slow, good = sockets(socket.SOCK_STREAM), sockets(socket.SOCK_STREAM)
    slow.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
    for client in (slow, good):
        client.connect(("127.0.0.1", vehicle.address.port))
        until(vehicle, lambda got: True)
    until(vehicle, lambda got: len(vehicle.peers) == 2)
    slow_peer, good_peer = vehicle.peers
    # no trailing zeros: a frame of the greatest length
    message = m.MAVLink_file_transfer_protocol_message(0, 0, 0, [65] * 251)
    good.setblocking(False)
    count, got = 0, bytearray()
    while slow_peer.dropped < 500:
        vehicle.send(message)
        vehicle.receive()
        count += 1
        while True:
            try:
                got += good.recv(1 << 16)
            except BlockingIOError:
                break
        assert count < 60_000
    assert slow_peer.waiting <= OUTBOX_BYTES and good_peer.dropped == 0
    # the slow client later reads whole frames: the dropped ones are missing, none is truncated
    clock.now += STALLED_S / 2
    read = bytearray()
    slow.settimeout(0.2)
    for _ in range(4):
        vehicle.receive()
        try:
            while len(read) < count * LONGEST:
                read += slow.recv(1 << 16)
                vehicle.receive()
        except TimeoutError:
            pass
    frames, used = split(bytes(read), check := Statistics())
    assert used == len(read) and check.skipped_bytes == 0 and len(frames) == slow_peer.sent
    good.settimeout(0.2)
    while len(got) < count * len(frames[0]):
        got += good.recv(1 << 16)
    assert len(split(bytes(got), check)[0]) == count == good_peer.sent and check.skipped_bytes == 0
    # a client that reads nothing for long is disconnected
    while not slow_peer.dropped > 1000:
        vehicle.send(message)
    clock.now += 2 * STALLED_S
    vehicle.send_to(good_peer, heartbeat())
    for _ in range(50):
        vehicle.receive()
        good.recv(1 << 16)
        if vehicle.peers == (good_peer,):
            break
    assert vehicle.peers == (good_peer,)


def test_tcpout_reconnects(opened: Callable[..., Link], sockets: Callable[..., Any]) -> None:
    clock = Clock()
    server = sockets(socket.SOCK_STREAM)
    server.bind(("127.0.0.1", 0))
    vehicle = opened(f"tcpout:127.0.0.1:{server.getsockname()[1]}", clock=clock)
    for _ in range(20):  # nobody listens yet
        assert vehicle.receive() == [] and vehicle.peers == ()
        clock.now += 0.2
    server.listen()
    for _ in range(2):
        for _ in range(200):
            vehicle.receive()
            if vehicle.peers:
                break
            clock.now += 0.1
            time.sleep(0.001)
        client, _ = server.accept()
        with client:
            client.settimeout(5)
            vehicle.send(heartbeat())
            assert decoded(client.recv(300))[0].get_type() == "HEARTBEAT"
            client.sendall(frame_of(heartbeat()))
            until(vehicle, bool)
        until(vehicle, lambda got: not vehicle.peers)


# --- serial --------------------------------------------------------------------------------------


def test_a_serial_line(opened: Callable[..., Link]) -> None:
    pytest.importorskip("serial", reason="pyserial is not installed")
    pty = pytest.importorskip("pty", reason="this system has no pseudo-terminals")
    import tty

    far, near = pty.openpty()
    try:
        tty.setraw(near)
        vehicle = opened(f"serial:{os.ttyname(near)}:115200")
        sent = [vehicle.send(m.MAVLink_ping_message(i, 0, 0, 0)) for i in range(5)]
        vehicle.receive()
        read = b""
        while len(read) < sum(map(len, sent)):
            read += os.read(far, 4096)
        assert read == b"".join(sent)
        data = frame_of(heartbeat()) + frame_of(m.MAVLink_ping_message(3, 0, 0, 0), 1)
        os.write(far, data[:25])
        os.write(far, data[25:])
        assert [message.get_type() for _, message in until(vehicle, lambda got: len(got) == 2)] == ["HEARTBEAT", "PING"]
        while not vehicle.statistics.dropped_frames:  # nobody reads
            vehicle.send(heartbeat())
        assert vehicle.peers[0].waiting <= OUTBOX_BYTES
    finally:
        os.close(far)
        os.close(near)


def test_a_missing_device() -> None:
    pytest.importorskip("serial", reason="pyserial is not installed")
    with pytest.raises(InputError, match="does not open"):
        open_link("serial:/dev/no-such-device:57600")


def test_serial_without_pyserial(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(__import__("sys").modules, "serial", None)
    with pytest.raises(InputError, match="needs pyserial, which is not installed: pip install"):
        open_link("serial:/dev/ttyUSB0:57600")


# --- invalid input and floods --------------------------------------------------------------------


class Stream:
    """A 200 Hz stream of numbered messages to a ground tool, tick by tick, and the numbers that the tool received."""

    def __init__(self, opened: Callable[..., Link], kind: str) -> None:
        self.vehicle = opened(f"{kind}in:127.0.0.1:0")
        self.ground = opened(f"{kind}out:127.0.0.1:{self.vehicle.address.port}", system=255)
        until(self.ground, lambda got: bool(self.ground.peers))
        self.ground.send(heartbeat())
        until(self.vehicle, bool)
        self.sent, self.numbers = 0, []

    def tick(self) -> list[Any]:
        self.vehicle.send(m.MAVLink_ping_message(self.sent, 0, 0, 0))
        self.sent += 1
        self.numbers += [message.time_usec for _, message in self.ground.receive()]
        return self.vehicle.receive()

    def complete(self) -> bool:
        for _ in range(2000):
            if len(self.numbers) == self.sent:
                break
            self.numbers += [message.time_usec for _, message in self.ground.receive()]
            time.sleep(0.001)
        return self.numbers == list(range(self.sent))


@pytest.mark.parametrize("kind", ["udp", "tcp"])
def test_five_megabytes_of_random_bytes(kind: str, opened: Callable[..., Link], sockets: Callable[..., Any]) -> None:
    stream = Stream(opened, kind)
    draw = random.Random(5)
    attacker = sockets(socket.SOCK_DGRAM if kind == "udp" else socket.SOCK_STREAM)
    attacker.connect(("127.0.0.1", stream.vehicle.address.port))
    total, heard = 0, 0
    if kind == "tcp":
        attacker.setblocking(False)
    while total < 5_000_000:
        piece = draw.randbytes(draw.randint(1, 1400))
        with suppress(BlockingIOError):
            total += attacker.send(piece)
        heard += sum(peer.system != 255 for peer, _ in stream.tick())
    assert stream.complete()
    assert stream.vehicle.statistics.received_bytes > 4_000_000  # the rest did not fit the system's buffer
    assert heard == 0


def every_message() -> list[tuple[str, bytes]]:
    """One frame of every message of the dialect, with random fields."""
    draw = random.Random(2)
    frames = []
    for number, kind in sorted(m.mavlink_map.items()):
        payload = draw.randbytes(kind.unpacker.size - 1) + b"\x01"  # trailing zeros would not be sent
        body = bytes((0xFD, len(payload), 0, 0, 7, 255, 190)) + number.to_bytes(3, "little") + payload
        checksum = m.x25crc(body[1:] + bytes((kind.crc_extra,))).crc
        frames.append((kind.msgname, body + checksum.to_bytes(2, "little")))
    return frames


def test_every_message_whole_and_truncated_at_every_length(opened: Callable[..., Link], sockets: Callable[..., Any]) -> None:
    vehicle = opened("udpin:127.0.0.1:0")
    client = sockets()
    client.connect(("127.0.0.1", vehicle.address.port))
    frames = every_message()
    got, sent = [], 0
    for _, frame in frames:
        for length in range(len(frame)):
            client.send(frame[:length])
            sent += 1
            if sent % 100 == 0:
                assert vehicle.receive() == []
        while vehicle._peers and vehicle._peers[0].has_input():
            assert vehicle.receive() == []
        client.send(frame)
        got += [message.get_type() for _, message in until(vehicle, bool)]
    assert got == [name for name, _ in frames]
    assert vehicle.statistics.undecodable == 0


def test_a_wrong_byte_anywhere_is_detected() -> None:
    counts = Statistics()
    for _, frame in every_message()[::7]:
        for at in range(len(frame)):
            broken = bytearray(frame)
            broken[at] ^= 0x40
            found, _ = split(bytes(broken), counts)
            # a valid frame inside another's payload would need 24 matching bits
            assert found == []
        assert split(frame, counts) == ([frame], len(frame))


def test_oversized_and_unknown(opened: Callable[..., Link], sockets: Callable[..., Any]) -> None:
    vehicle = opened("udpin:127.0.0.1:0")
    client = sockets()
    client.connect(("127.0.0.1", vehicle.address.port))
    good = frame_of(heartbeat())
    client.send(good * (LARGEST // len(good) + 1))
    newer = bytearray(good)
    newer[2] = 0x02  # an unknown incompatibility flag
    client.send(bytes(newer))
    client.send(bytes((0xFD, 0, 0, 0, 0, 1, 1, 0xFF, 0xFF, 0x7F, 0, 0)))  # an unknown message
    client.send(good)
    assert len(until(vehicle, bool)) == 1
    assert vehicle.statistics.oversized == 1 and vehicle.statistics.unknown >= 2


def test_work_on_malicious_bytes_is_bounded() -> None:
    # headers of a known message without a valid frame
    hostile = bytes((0xFD, 9, 0, 0, 0, 1, 1, 0, 0, 0)) * 400
    counts = Statistics()
    assert split(hostile, counts) == ([], len(hostile))
    assert counts.wrong_checksum <= 16 and counts.skipped_bytes == len(hostile)


def _flood(opened: Callable[..., Link], sockets: Callable[..., Any], seconds: float) -> None:
    stream = Stream(opened, "udp")
    flooder = sockets()
    flooder.connect(("127.0.0.1", stream.vehicle.address.port))
    commands = [frame_of(m.MAVLink_command_long_message(1, 1, 512, 0, 1, 0, 0, 0, 0, 0, 0), i % 256, 254) for i in range(256)]
    ticks = round(200 * seconds)
    flooded, asked, answered = 0, 0, 0
    for tick in range(ticks):
        while flooded < 10_000 * (tick + 1) / 200:
            flooder.send(commands[flooded % 256])
            flooded += 1
        if tick % 20 == 0:
            stream.ground.send(heartbeat())
            asked += 1
        got = stream.tick()
        assert len(got) <= MESSAGES_PER_CALL
        answered += sum(message.get_srcSystem() == 255 for _, message in got)
    assert flooded == 10_000 * seconds
    for _ in range(100):
        answered += sum(message.get_srcSystem() == 255 for _, message in stream.vehicle.receive())
    # the stream is complete, and all messages of the ground tool were received
    assert stream.complete() and stream.sent == ticks
    assert answered == asked
    assert all(peer.stored <= INBOX_BYTES for peer in stream.vehicle._peers)  # type: ignore[attr-defined]


def test_a_flood_does_not_stop_the_stream(opened: Callable[..., Link], sockets: Callable[..., Any]) -> None:
    _flood(opened, sockets, 1)


@pytest.mark.skipif("INSENV_TEST_MAVLINK" not in os.environ, reason="10 s of flood: make test-mavlink")
def test_a_long_flood_does_not_stop_the_stream(opened: Callable[..., Link], sockets: Callable[..., Any]) -> None:
    _flood(opened, sockets, 10)
