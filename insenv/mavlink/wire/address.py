"""Addresses of a link: ``udpout:HOST:PORT``, ``udpin:HOST:PORT``, ``tcpin:HOST:PORT``, ``tcpout:HOST:PORT``,
``serial:DEVICE:BAUD``."""

from __future__ import annotations

import socket
from dataclasses import dataclass
from typing import Any

from insenv.base.errors import InputError

KINDS = {
    "udpout": "udpout:HOST:PORT",
    "udpin": "udpin:HOST:PORT",
    "tcpout": "tcpout:HOST:PORT",
    "tcpin": "tcpin:HOST:PORT",
    "serial": "serial:DEVICE:BAUD",
}
LOOPBACK = "127.0.0.1"
BAUD = 57600
_HIGHEST_PORT = 65535


@dataclass(frozen=True)
class Address:
    """The address of a link.

    kind: a key of `KINDS`.  host: name, IP address or serial device.  port: network port, or baud rate.
    """

    kind: str
    host: str
    port: int

    def __str__(self) -> str:
        return f"{self.kind}:{endpoint(self.host, self.port)}"


def endpoint(host: str, port: int) -> str:
    """``HOST:PORT``, an IPv6 host in brackets."""
    return f"{f'[{host}]' if ':' in host else host}:{port}"


def parse_address(text: str) -> Address:
    """Parse an address; an empty host is the loopback address 127.0.0.1.  Raises `InputError`."""
    kind, _, rest = text.partition(":")
    if kind not in KINDS:
        raise InputError(f"address {text!r}: must be {', '.join(KINDS.values())}")
    form = KINDS[kind]
    if kind == "serial":
        device, colon, baud = rest.rpartition(":")
        device, baud = (device, baud) if colon and baud.isdigit() else (rest, str(BAUD))
        if not device or not 0 < int(baud) <= 100_000_000:
            raise InputError(f"address {text!r}: must be {form}, such as serial:/dev/ttyUSB0:{BAUD}")
        return Address(kind, device, int(baud))
    host, _, port = rest.rpartition(":")
    lowest = 1 if kind.endswith("out") else 0
    if not port.isascii() or not port.isdigit() or not lowest <= int(port) <= _HIGHEST_PORT:
        raise InputError(f"address {text!r}: must be {form} with a port from {lowest} to {_HIGHEST_PORT}")
    if host.startswith("[") and host.endswith("]"):
        host = host[1:-1]
    elif ":" in host:
        raise InputError(f"address {text!r}: an IPv6 host is written in brackets, such as {kind}:[::1]:{port}")
    return Address(kind, host or LOOPBACK, int(port))


def resolve(address: Address, kind: socket.SocketKind) -> tuple[socket.AddressFamily, Any]:
    """Address family and socket address, IPv4 preferred.  Raises `InputError` when the host is unknown."""
    try:
        found = socket.getaddrinfo(address.host, address.port, type=kind)
    except (OSError, UnicodeError) as error:
        raise InputError(f"address {address}: unknown host {address.host!r}: {error}") from None
    found.sort(key=lambda entry: entry[0] != socket.AF_INET)
    return found[0][0], found[0][4]
