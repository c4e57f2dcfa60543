"""Frames cut out of bytes: every message whole, truncated and with a wrong byte; hostile bytes."""

import random

from pymavlink.dialects.v20 import common as m
from streamed_vehicle import until

from insenv.mavlink.wire import Statistics
from insenv.mavlink.wire.frames import split


def every_message():
    """One frame of every message of the dialect, with random fields."""
    draw = random.Random(2)
    for number, kind in sorted(m.mavlink_map.items()):
        payload = draw.randbytes(kind.unpacker.size - 1) + b"\x01"  # trailing zeros would not be sent
        body = bytes((0xFD, len(payload), 0, 0, 7, 255, 190)) + number.to_bytes(3, "little") + payload
        yield kind.msgname, body + m.x25crc(body[1:] + bytes((kind.crc_extra,))).crc.to_bytes(2, "little")


def test_every_message_whole_and_truncated_at_every_length(opened, sockets):
    vehicle = opened("udpin:127.0.0.1:0")
    client = sockets(to=vehicle.address.port)
    frames, got, sent = list(every_message()), [], 0
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
    assert got == [name for name, _ in frames] and vehicle.statistics.undecodable == 0


def test_a_wrong_byte_anywhere_is_detected():
    counts = Statistics()
    for _, frame in list(every_message())[::7]:
        for at in range(len(frame)):
            broken = bytearray(frame)
            broken[at] ^= 0x40
            # a valid frame inside another's payload would need 24 matching bits
            assert split(bytes(broken), counts)[0] == []
        assert split(frame, counts) == ([frame], len(frame))


def test_work_on_malicious_bytes_is_bounded():
    """Headers of a known message without a valid frame."""
    hostile = bytes((0xFD, 9, 0, 0, 0, 1, 1, 0, 0, 0)) * 400
    counts = Statistics()
    assert split(hostile, counts) == ([], len(hostile))
    assert counts.wrong_checksum <= 16 and counts.skipped_bytes == len(hostile)
