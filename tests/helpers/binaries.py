"""What a shared library exports and for which processor it is, from its bytes: Mach-O (macOS), PE (Windows)."""

import struct
from pathlib import Path
from typing import NamedTuple

MACH_PROCESSORS = {0x01000007: "x86_64", 0x0100000C: "arm64"}
PE_PROCESSORS = {0x8664: "x86_64", 0xAA64: "arm64"}


class Binary(NamedTuple):
    processor: str
    exports: frozenset[str]
    needs: frozenset[str]
    name: str = ""


def read(path: Path) -> list[Binary]:
    """The binaries in a file: several in a universal one of macOS."""
    data = path.read_bytes()
    if data[:2] == b"MZ":
        return [_pe(data)]
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


def _pe(data: bytes) -> Binary:
    at = struct.unpack_from("<I", data, 0x3C)[0]
    assert data[at : at + 4] == b"PE\0\0"
    processor, sections, optional = *struct.unpack_from("<2H", data, at + 4), struct.unpack_from("<H", data, at + 20)[0]
    assert struct.unpack_from("<H", data, at + 22)[0] & 0x2000, "not a DLL"
    table = [struct.unpack_from("<4I", data, at + 24 + optional + 40 * k + 8) for k in range(sections)]

    def offset(address: int) -> int:
        return next(raw + address - start for size, start, _, raw in table if start <= address < start + size)

    assert struct.unpack_from("<H", data, at + 24)[0] == 0x20B, "not PE32+"
    directories = at + 24 + 112
    place = offset(struct.unpack_from("<I", data, directories)[0])
    count, names = struct.unpack_from("<I", data, place + 24)[0], struct.unpack_from("<I", data, place + 32)[0]
    addresses = struct.unpack_from(f"<{count}I", data, offset(names))
    needs, entry = set(), offset(struct.unpack_from("<I", data, directories + 8)[0])
    while name := struct.unpack_from("<I", data, entry + 12)[0]:
        needs.add(_text(data, offset(name)))
        entry += 20
    return Binary(PE_PROCESSORS[processor], frozenset(_text(data, offset(a)) for a in addresses), frozenset(needs))
