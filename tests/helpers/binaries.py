"""What a shared library of macOS (Mach-O) exports and for which processor it is, from its bytes."""

import struct
from pathlib import Path
from typing import NamedTuple

MACH_PROCESSORS = {0x01000007: "x86_64", 0x0100000C: "arm64"}


class Binary(NamedTuple):
    processor: str
    exports: frozenset[str]
    needs: frozenset[str]
    name: str = ""


def read(path: Path) -> list[Binary]:
    """The binaries in a file: several in a universal one of macOS."""
    data = path.read_bytes()
    if data[:4] == b"\xca\xfe\xba\xbe":  # universal: a big-endian table of the parts
        count = struct.unpack_from(">I", data, 4)[0]
        parts = [struct.unpack_from(">5I", data, 8 + 20 * k) for k in range(count)]
        assert all(at % (1 << align) == 0 for _, _, at, _, align in parts)
        found = [_mach(data[at : at + size]) for _, _, at, size, _ in parts]
        assert [MACH_PROCESSORS[processor] for processor, *_ in parts] == [part.processor for part in found]
        return found
    return [_mach(data)]


def _text(data: bytes, at: int) -> str:
    return data[at : data.index(b"\0", at)].decode("ascii")


def _mach(data: bytes) -> Binary:
    magic, processor, _, kind, commands = struct.unpack_from("<5I", data)
    assert magic == 0xFEEDFACF, "not a 64-bit Mach-O file"
    assert kind == 6, "not a dylib"
    at, name, needs, exports = 32, "", set(), set()
    for _ in range(commands):
        command, size = struct.unpack_from("<2I", data, at)
        if command in (0xD, 0xC):  # LC_ID_DYLIB, LC_LOAD_DYLIB: the offset of a name
            text = _text(data, at + struct.unpack_from("<I", data, at + 8)[0])
            if command == 0xD:
                name = text
            else:
                needs.add(text)
        elif command == 0x2:  # LC_SYMTAB
            symbols, count, strings, _ = struct.unpack_from("<4I", data, at + 8)
            for k in range(count):
                place, flags, section = struct.unpack_from("<IBB", data, symbols + 16 * k)
                if flags & 0x01 and not flags & 0x10 and section:  # external, not private external, defined here
                    exports.add(_text(data, strings + place).removeprefix("_"))
        at += size
    return Binary(MACH_PROCESSORS[processor], frozenset(exports), frozenset(needs), name)
