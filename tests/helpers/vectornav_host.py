"""A host of a VectorNav unit: frames as the structures of ArduPilot's drivers read them, and commands with their checksum."""

import struct
from binascii import crc_hqx
from collections import defaultdict
from functools import reduce
from operator import xor

PACKETS = {
    "012107": "<Q17f", "31010006011306": "<Q10fH3d5f", "490300b8261800": "<QQBB3d3f3ff7fBB", "1101000601": "<Q10f",
    "342e0706011206": "<9ff9f10f3d5f", "4e02001000b8201800": "<QfBB3d3f7fBB", "143e070400": "<9f2f9f4f", "010002": "<6f",
}  # fmt: skip
"""Structure by header: of the present driver, of an older one, and UncompAccel with UncompGyro alone."""
INS = ("time", "ypr", "quaternion", "sigmas", "status", "place", "velocity", "position_sigma", "velocity_sigma")


def read(data, at=0):
    """The packets in `data`, by header, the INS packet by `INS`; fails on anything between them."""
    found = defaultdict(list)
    while at < len(data):
        assert data[at] == 0xFA, data[at : at + 20]
        header = next(h for h in PACKETS if data[at + 1 :].startswith(bytes.fromhex(h)))
        begin, form = at + 1 + len(header) // 2, PACKETS[header]
        end = begin + struct.calcsize(form) + 2
        if end > len(data):  # cut off at the end
            break
        assert crc_hqx(data[at + 1 : end], 0) == 0  # CRC-16-CCITT, as AP_Math's crc16_ccitt with start 0
        v = struct.unpack_from(form, data, begin)
        if header == "31010006011306":
            v = (v[0], v[1:4], v[4:8], v[8:11], v[11], v[12:15], v[15:18], v[18], v[19])
        found[header].append(v)
        at = end
    return dict(found)


def commands(*bodies):
    """The lines of commands, each with the exclusive or of its characters."""
    return "".join(f"${body}*{reduce(xor, body.encode()):02X}\r\n" for body in bodies).encode()
