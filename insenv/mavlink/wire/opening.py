"""Open a link by its address."""

from __future__ import annotations

import time

from insenv.mavlink.wire.address import parse_address
from insenv.mavlink.wire.datagrams import DatagramLink
from insenv.mavlink.wire.link import Clock, Link
from insenv.mavlink.wire.signing import Signing
from insenv.mavlink.wire.streams import SerialLink, TcpClientLink, TcpServerLink

_LINKS: dict[str, type[Link]] = {
    "udpout": DatagramLink,
    "udpin": DatagramLink,
    "tcpin": TcpServerLink,
    "tcpout": TcpClientLink,
    "serial": SerialLink,
}


def open_link(
    address: str,
    *,
    signing: Signing | None = None,
    system: int = 1,
    component: int = 1,
    clock: Clock = time.monotonic,
    number: int | None = None,
) -> Link:
    """Open a link.

    address: ``udpout:HOST:PORT`` sends to one place; ``udpin:HOST:PORT`` to everyone who sends MAVLink to it;
    ``tcpin:HOST:PORT`` to every client; ``tcpout:HOST:PORT`` connects, and reconnects when the connection is lost;
    ``serial:DEVICE:BAUD``.  Without HOST: the loopback address.  Port 0 of an ``in`` address selects a free port
    (`link.address.port`).  signing: signs outgoing frames and rejects all that are not signed with the same key.
    system, component: the sender that messages state, 1 to 255.  clock: seconds, for the expiry of peers.  number: the
    link number in its signatures, where several links share one `signing`.  Raises `InputError`: a wrong address, an
    unknown host, a port in use, a device that does not open, pyserial not installed.
    """
    parsed = parse_address(address)
    return _LINKS[parsed.kind](parsed, signing, system, component, clock, number)
