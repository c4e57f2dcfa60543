"""Links: addresses, datagrams and streams, peers that come and go, floods."""

import itertools
import os
import socket
import struct
import time

import pytest
from peers import package
from pymavlink.dialects.v20 import common as m
from streamed_vehicle import Clock, decoded, frame_of, heartbeat, ping, until

from insenv.base.errors import InputError
from insenv.mavlink.wire import Statistics, open_link, parse_address
from insenv.mavlink.wire.frames import split
from insenv.mavlink.wire.link import INBOX_BYTES, MESSAGES_PER_CALL, OUTBOX_BYTES
from insenv.mavlink.wire.transports import EXPIRY_S, MAX_CLIENTS, MAX_DATAGRAM_BYTES, MAX_PEERS, MAX_STRANGERS, STALLED_S

TCP = socket.SOCK_STREAM


@pytest.mark.parametrize(("text", "kind", "host", "port"), [
    ("udpin::14550", "udpin", "127.0.0.1", 14550),
    ("tcpout:[::1]:5760", "tcpout", "::1", 5760),
    ("serial:/dev/ttyUSB0", "serial", "/dev/ttyUSB0", 57600),
])  # fmt: skip
def test_addresses(text, kind, host, port):
    address = parse_address(text)
    assert (address.kind, address.host, address.port) == (kind, host, port) and parse_address(str(address)) == address


def test_links_that_cannot_be_opened_are_errors(opened, monkeypatch):
    port = opened("udpin:127.0.0.1:0").address.port
    for address, message in (
        (f"udpin:127.0.0.1:{port}", str(port)),
        ("tcpin:192.0.2.1:5760", r"192\.0\.2\.1"),  # not an address of this machine
        ("serial:/dev/no-such-device:57600", "does not open"),
    ):
        with pytest.raises(InputError, match=message):
            open_link(address)
    monkeypatch.setitem(__import__("sys").modules, "serial", None)
    with pytest.raises(InputError, match="needs pyserial, which is not installed"):
        open_link("serial:/dev/ttyUSB0:57600")


def test_each_peer_and_the_log_have_consecutive_sequence_numbers(opened):
    vehicle = opened("udpin:127.0.0.1:0")
    grounds = [opened(f"udpout:127.0.0.1:{vehicle.address.port}", system=250 + i) for i in range(3)]
    logged = []
    for turn in range(100):
        for ground in grounds[: 1 + turn // 30]:  # one after another
            ground.send(heartbeat())
        until(vehicle, lambda got: len({peer for peer, _ in got}) == min(1 + turn // 30, 3))  # noqa: B023
        logged += [vehicle.send(heartbeat()) for _ in range(3)]
        logged += [vehicle.send_to(peer, ping(turn)) for peer in vehicle.peers[turn % len(vehicle.peers) :]]
    assert [frame[4] for frame in logged] == [i % 256 for i in range(len(logged))]
    for ground, peer in zip(grounds, vehicle.peers, strict=True):
        numbers = [message.get_seq() for _, message in until(ground, lambda got: len(got) == peer.sent)]  # noqa: B023
        assert [(b - a) % 256 for a, b in itertools.pairwise(numbers)] == [1] * (len(numbers) - 1)


def test_udpout_survives_a_client_that_comes_and_goes_and_hears_it_only(opened, sockets):
    first = sockets(bound=True)
    place = first.getsockname()
    vehicle = opened(f"udpout:127.0.0.1:{place[1]}")
    for _ in range(5):
        vehicle.send(heartbeat())
    first.close()
    for _ in range(20):  # the system reports that nobody listens, which has no effect
        vehicle.send(heartbeat())
        assert vehicle.receive() == []
    again = sockets()
    again.bind(place)
    for _ in range(10):
        vehicle.send(heartbeat())
    assert [decoded(again.recv(300))[0].get_seq() for _ in range(10)] == list(range(25, 35))
    vehicle.send(heartbeat())
    _, source = again.recvfrom(300)
    sockets().sendto(frame_of(heartbeat()), source)
    again.sendto(frame_of(heartbeat(), sequence=9), source)
    assert [message.get_seq() for _, message in until(vehicle, bool)] == [9]


def test_numbers_of_peers_and_strangers_are_limited_and_present_peers_stay_until_they_expire(opened, sockets):
    clock = Clock()
    vehicle = opened("udpin:127.0.0.1:0", clock=clock)
    clients = [sockets(to=vehicle.address.port) for _ in range(MAX_PEERS + 3)]
    for client in clients:
        client.send(frame_of(heartbeat()))
        until(vehicle, bool)  # all are answered
    assert len(vehicle.peers) == MAX_PEERS and vehicle.statistics.refused_peers == 3
    there = vehicle.peers
    for _ in range(3 * MAX_STRANGERS):
        sockets(to=vehicle.address.port).send(b"\xfdgarbage")
        vehicle.receive()
    assert vehicle.peers == there
    assert len(vehicle._peers) <= MAX_PEERS + MAX_STRANGERS
    clock.now += EXPIRY_S - 1
    clients[0].send(frame_of(heartbeat()))
    assert until(vehicle, bool)[0][0] is there[0]
    clock.now += 2
    assert vehicle.receive() == [] and vehicle.peers == there[:1]
    clients[-1].send(frame_of(heartbeat()))
    until(vehicle, bool)
    assert len(vehicle.peers) == 2


def test_invalid_datagrams_are_counted_and_make_no_peer(opened, sockets):
    vehicle = opened("udpin:127.0.0.1:0", system=3, component=1)
    stranger, good = sockets(to=vehicle.address.port), frame_of(heartbeat())
    broken, newer = bytearray(good), bytearray(good)
    broken[-1] ^= 1
    newer[2] = 0x02  # an unknown incompatibility flag
    unknown = bytes((0xFD, 0, 0, 0, 0, 1, 1, 0xFF, 0xFF, 0x7F, 0, 0))  # an unknown message
    for piece in (b"", b"hello", bytes(broken), good * (MAX_DATAGRAM_BYTES // len(good) + 1), bytes(newer), unknown):
        stranger.send(piece)
    stranger.send(frame_of(heartbeat(), 0, 3, 1))  # our own, returned: no command
    time.sleep(0.02)
    assert vehicle.receive() == [] and vehicle.peers == ()
    counts = vehicle.statistics
    assert (counts.wrong_checksum, counts.oversized, counts.reflected) == (1, 1, 1) and counts.unknown >= 2
    stranger.send(frame_of(heartbeat(), 1, 3, 2))  # another component of the vehicle
    assert [message.get_seq() for _, message in until(vehicle, bool)] == [1]


def test_tcp_frames_in_single_bytes_and_with_a_lost_byte(opened, sockets):
    vehicle = opened("tcpin:127.0.0.1:0")
    client = sockets(TCP, to=vehicle.address.port)
    client.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
    got = []
    for byte in b"".join(frame_of(ping(i), i) for i in range(4)):
        client.send(bytes((byte,)))
        got += vehicle.receive()
    got += until(vehicle, lambda more: len(got) + len(more) == 4)
    assert [message.time_usec for _, message in got] == [0, 1, 2, 3] and vehicle.statistics.skipped_bytes == 0
    frames = [frame_of(ping(i), i) for i in range(40)]
    frames[20] = frames[20][:7] + frames[20][8:]
    client.sendall(b"\x00\xfd\xfe" + b"".join(frames))
    got = until(vehicle, lambda got: got and got[-1][1].time_usec == 39)
    assert [message.time_usec for _, message in got] == [i for i in range(40) if i != 20]


def test_tcp_clients_come_and_go_and_their_number_is_limited(opened, sockets):
    vehicle = opened("tcpin:127.0.0.1:0")
    for _ in range(2):
        client = sockets(TCP, to=vehicle.address.port)
        client.sendall(frame_of(heartbeat()))
        until(vehicle, bool)
        assert len(vehicle.peers) == 1
        vehicle.send(heartbeat())
        assert decoded(client.recv(300))[0].get_type() == "HEARTBEAT"
        # a reset instead of an orderly close
        client.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))
        client.close()
        vehicle.send(heartbeat())
        until(vehicle, lambda got: vehicle.send(heartbeat()) and not vehicle.peers)
    for _ in range(MAX_CLIENTS + 2):
        sockets(TCP, to=vehicle.address.port)
        vehicle.receive()
    until(vehicle, lambda got: vehicle.statistics.refused_peers == 2)
    assert len(vehicle.peers) == MAX_CLIENTS


def drained(link, client, data):
    """Add to `data` what a client can read, while the link sends what waits."""
    client.setblocking(False)
    for _ in range(40):
        link.receive()
        try:
            while part := client.recv(1 << 16):
                data += part
                link.receive()
        except BlockingIOError:
            time.sleep(0.002)
    return data


def test_a_tcp_client_that_does_not_read_delays_no_other(opened, sockets):
    clock = Clock()
    vehicle = opened("tcpin:127.0.0.1:0", clock=clock)
    slow, good = sockets(TCP), sockets(TCP)
    slow.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
    for number, client in enumerate((slow, good), 1):
        client.connect(("127.0.0.1", vehicle.address.port))
        until(vehicle, lambda got: len(vehicle.peers) == number)  # noqa: B023
    slow_peer, good_peer = vehicle.peers
    # no trailing zeros: a frame of the greatest length
    message = m.MAVLink_file_transfer_protocol_message(0, 0, 0, [65] * 251)
    good.setblocking(False)
    count, got = 0, bytearray()
    while slow_peer.dropped < 500:
        for _ in range(10):
            vehicle.send(message)
        vehicle.receive()
        count += 10
        try:
            got += good.recv(1 << 16)
        except BlockingIOError:
            continue
        assert count < 60_000
    assert slow_peer.waiting <= OUTBOX_BYTES and good_peer.dropped == 0
    # the slow client later reads whole frames: the dropped ones are missing, none is truncated
    clock.now += STALLED_S / 2
    read = drained(vehicle, slow, bytearray())
    frames, used = split(bytes(read), check := Statistics())
    assert used == len(read) and not check.skipped_bytes and len(frames) == slow_peer.sent and len(frames[0]) <= 280
    assert len(split(bytes(drained(vehicle, good, got)), check)[0]) == count == good_peer.sent and check.skipped_bytes == 0
    # a client that reads nothing for long is disconnected
    while slow_peer.dropped <= 1000:
        vehicle.send(message)
    clock.now += 2 * STALLED_S
    vehicle.send_to(good_peer, heartbeat())
    until(vehicle, lambda _: drained(vehicle, good, got) and vehicle.peers == (good_peer,), tries=50)


def test_tcpout_reconnects(opened, sockets):
    clock, server = Clock(), sockets(TCP, bound=True)
    vehicle = opened(f"tcpout:127.0.0.1:{server.getsockname()[1]}", clock=clock)
    for _ in range(20):  # nobody listens yet
        assert vehicle.receive() == [] and vehicle.peers == ()
        clock.now += 0.2
    server.listen()
    for _ in range(2):
        until(vehicle, lambda got: vehicle.peers or clock.sleep(0.1))
        client, _ = server.accept()
        with client:
            client.settimeout(5)
            vehicle.send(heartbeat())
            assert decoded(client.recv(300))[0].get_type() == "HEARTBEAT"
            client.sendall(frame_of(heartbeat()))
            until(vehicle, bool)
        until(vehicle, lambda got: not vehicle.peers)


def test_a_serial_line(opened):
    package("serial")
    pty = pytest.importorskip("pty", reason="this system has no pseudo-terminals")
    import tty

    far, near = pty.openpty()
    try:
        tty.setraw(near)
        vehicle = opened(f"serial:{os.ttyname(near)}:115200")
        sent = vehicle.send(ping(0))
        vehicle.receive()
        assert os.read(far, 4096) == sent
        os.write(far, frame_of(heartbeat()) + frame_of(ping(3), 1))
        assert [message.get_type() for _, message in until(vehicle, lambda got: len(got) == 2)] == ["HEARTBEAT", "PING"]
        while not vehicle.statistics.dropped_frames:  # nobody reads
            vehicle.send(heartbeat())
        assert vehicle.peers[0].waiting <= OUTBOX_BYTES
    finally:
        os.close(far)
        os.close(near)


def test_a_flood_of_10000_commands_a_second_does_not_stop_the_stream(opened, sockets):
    vehicle = opened("udpin:127.0.0.1:0")
    ground = opened(f"udpout:127.0.0.1:{vehicle.address.port}", system=255)
    until(ground, lambda got: bool(ground.peers))
    ground.send(heartbeat())
    until(vehicle, bool)
    flooder = sockets(to=vehicle.address.port)
    arm = m.MAVLink_command_long_message(1, 1, 512, 0, 1, 0, 0, 0, 0, 0, 0)
    commands = [frame_of(arm, i, 254) for i in range(50)]
    ticks, heard, answered = 200, [], []
    for tick in range(ticks):
        for each in commands:
            flooder.send(each)
        if tick % 20 == 0:
            ground.send(heartbeat())
        vehicle.send(ping(tick))
        heard += ground.receive()
        got = vehicle.receive()
        assert len(got) <= MESSAGES_PER_CALL
        answered += got
    for _ in range(100):
        answered += vehicle.receive()
    heard += until(ground, lambda got: len(heard) + len(got) == ticks)
    # the stream is complete, and all messages of the ground tool were received
    assert [message.time_usec for _, message in heard] == list(range(ticks))
    assert sum(message.get_srcSystem() == 255 for _, message in answered) == ticks // 20
    assert all(peer.stored <= INBOX_BYTES for peer in vehicle._peers)
