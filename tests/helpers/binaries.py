"""What a shared library exports and for which processor it is, from its bytes: Mach-O (macOS), PE (Windows), ELF (Linux)."""

import struct
from pathlib import Path
from typing import NamedTuple

MACH_PROCESSORS = {0x01000007: "x86_64", 0x0100000C: "arm64"}
PE_PROCESSORS = {0x8664: "x86_64", 0xAA64: "arm64"}
ELF_PROCESSORS = {62: "x86_64", 183: "arm64"}


class Binary(NamedTuple):
    """processor; exported names (macOS: without the leading underscore); libraries that it needs; its own name (macOS)."""

    processor: str
    exports: frozenset[str]
    needs: frozenset[str]
    name: str = ""


def read(path: Path) -> list[Binary]:
    """The binaries in a file: several in a universal one of macOS."""
    data = path.read_bytes()
    if data[:4] == b"\x7fELF":
        return [_elf(data)]
    if data[:2] == b"MZ":
        return [_pe(data)]
    if data[:4] == b"\xca\xfe\xba\xbe":  # universal: a big-endian table of the parts
        count = struct.unpack_from(">I", data, 4)[0]
        parts = [struct.unpack_from(">5I", data, 8 + 20 * k) for k in range(count)]
        return [_checked(_mach(data[at : at + size]), processor) for processor, _, at, size, _ in parts]
    return [_mach(data)]


def _checked(binary: Binary, processor: int) -> Binary:
    assert binary.processor == MACH_PROCESSORS[processor], "the table of a universal binary contradicts its part"
    return binary


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


def _elf(data: bytes) -> Binary:
    processor = struct.unpack_from("<H", data, 18)[0]
    at, size, count = struct.unpack_from("<Q", data, 40)[0], *struct.unpack_from("<2H", data, 58)
    headers = [struct.unpack_from("<2I4Q2I2Q", data, at + size * k) for k in range(count)]
    exports, needs = set(), set()
    for _, kind, _, _, start, length, link, _, _, entry in headers:
        strings = headers[link][4] if kind in (6, 11) else 0
        for place in range(start, start + length, entry) if kind in (6, 11) else ():
            if kind == 11:  # .dynsym: global or weak, defined here
                name, info, _, section = struct.unpack_from("<IBBH", data, place)
                if info >> 4 in (1, 2) and section and name:
                    exports.add(_text(data, strings + name))
            else:  # .dynamic: DT_NEEDED
                tag, value = struct.unpack_from("<2Q", data, place)
                if tag == 1:
                    needs.add(_text(data, strings + value))
    return Binary(ELF_PROCESSORS[processor], frozenset(exports), frozenset(needs))
