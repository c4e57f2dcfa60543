"""Links, peers, frames, signing and telemetry logs.  Nothing here knows the simulation."""

from insenv.mavlink.wire.frames import Statistics, dialect
from insenv.mavlink.wire.link import Address, Link, Peer, parse_address
from insenv.mavlink.wire.signing import Signing
from insenv.mavlink.wire.transports import open_link

__all__ = ["Address", "Link", "Peer", "Signing", "Statistics", "dialect", "open_link", "parse_address"]
