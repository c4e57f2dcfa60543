"""What a link counts: sent, received, and everything that was turned away, by reason."""

from __future__ import annotations

from dataclasses import asdict, dataclass


@dataclass
class Statistics:
    """Counts since a link was opened.

    sent_messages: packed (to no, one or several peers); sent_frames, sent_bytes: handed to the system, summed over peers;
    dropped_frames: not sent because a peer reads too slowly or the system's buffer was full.
    received_messages: verified and handed out; received_bytes: read, whatever they were.
    Turned away: wrong_checksum, unknown (message number or incompatible flag; such frames cannot be checked), undecodable;
    unsigned, wrongly_signed, replayed (a signing time not newer than the last), stale (too old for a new sender), reflected
    (our own frames come back); oversized (datagrams beyond any of MAVLink), skipped_bytes (between frames), overflowed
    (datagrams or frames of a peer that sends more than is read), refused_peers (no room for another).
    """

    sent_messages: int = 0
    sent_frames: int = 0
    sent_bytes: int = 0
    dropped_frames: int = 0
    received_messages: int = 0
    received_bytes: int = 0
    wrong_checksum: int = 0
    unknown: int = 0
    undecodable: int = 0
    unsigned: int = 0
    wrongly_signed: int = 0
    replayed: int = 0
    stale: int = 0
    reflected: int = 0
    oversized: int = 0
    skipped_bytes: int = 0
    overflowed: int = 0
    refused_peers: int = 0

    def as_dict(self) -> dict[str, int]:
        """The counts by name."""
        return asdict(self)
