"""Messages of the common message set that pymavlink's module of it lacks: defined here, as pymavlink would.

A message's CRC_EXTRA is computed from its definition, as https://mavlink.io/en/guide/serialization.html defines it.
"""

from __future__ import annotations

import struct
from functools import lru_cache
from typing import Any

Definition = tuple[int, tuple[tuple[str, str, int], ...]]
"""Message number, and type, name and length (0: no array) of each field, in the order of the definition."""

DEFINITIONS: dict[str, Definition] = {
    "PROTOCOL_VERSION": (300, (
        ("uint16_t", "version", 0), ("uint16_t", "min_version", 0), ("uint16_t", "max_version", 0),
        ("uint8_t", "spec_version_hash", 8), ("uint8_t", "library_version_hash", 8),
    )),
    "COMPONENT_METADATA": (397, (("uint32_t", "time_boot_ms", 0), ("uint32_t", "file_crc", 0), ("char", "uri", 100))),
    "AVAILABLE_MODES": (435, (
        ("uint8_t", "number_modes", 0), ("uint8_t", "mode_index", 0), ("uint8_t", "standard_mode", 0),
        ("uint32_t", "custom_mode", 0), ("uint32_t", "properties", 0), ("char", "mode_name", 35),
    )),
    "CURRENT_MODE": (436, (
        ("uint8_t", "standard_mode", 0), ("uint32_t", "custom_mode", 0), ("uint32_t", "intended_custom_mode", 0),
    )),
}  # fmt: skip
_SIZES = {"uint32_t": (4, "I"), "uint16_t": (2, "H"), "uint8_t": (1, "B"), "char": (1, "s")}


@lru_cache(maxsize=1)
def further_messages() -> dict[str, Any]:
    """The classes of these messages by name."""
    return {name: _class(name, number, fields) for name, (number, fields) in DEFINITIONS.items()}


def crc_extra(name: str, ordered: list[tuple[str, str, int]]) -> int:
    """The byte that makes a checksum depend on the definition.  ordered: the fields in the order of sending."""
    from fastcrc import crc16

    text = f"{name} ".encode()
    for kind, field, length in ordered:
        text += f"{kind} {field} ".encode() + (bytes((length,)) if length else b"")
    checksum: int = crc16.mcrf4xx(text)
    return checksum & 0xFF ^ checksum >> 8


def _class(name: str, number: int, fields: tuple[tuple[str, str, int], ...]) -> Any:
    from pymavlink.dialects.v20 import common

    ordered = sorted(fields, key=lambda field: -_SIZES[field[0]][0])
    names = [field for _, field, _ in fields]
    extra = crc_extra(name, ordered)
    packer = struct.Struct("<" + "".join(f"{length or ''}{_SIZES[kind][1]}" for kind, _, length in ordered))

    class Further(common.MAVLink_message):
        """One of `DEFINITIONS`."""

        id = number
        msgname = name
        fieldnames = names
        fieldtypes = [kind for kind, _, _ in fields]
        orders = [[field for _, field, _ in ordered].index(field) for field in names]
        array_lengths = [length for _, _, length in ordered]

        def __init__(self, *values: Any) -> None:
            super().__init__(number, name)
            self._fieldnames = names
            for field, value in zip(names, values, strict=True):
                setattr(self, field, value)

        def pack(self, mav: Any, force_mavlink1: bool = False) -> bytes:
            """The frame."""
            values: list[Any] = []
            for _, field, _ in ordered:
                value = getattr(self, field)
                values += value if isinstance(value, (list, tuple)) else [value]
            packed: bytes = self._pack(mav, extra, packer.pack(*values), force_mavlink1=force_mavlink1)
            return packed

    Further.crc_extra = extra
    return Further
