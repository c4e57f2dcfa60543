"""Signing: pymavlink and insenv accept each other's signatures, and every known attack is tried."""

from __future__ import annotations

import itertools
import os
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from command_line import call, strict

from insenv.errors import InputError
from insenv.mavlink.wire import Link, Signing, Statistics, dialect
from insenv.mavlink.wire.frames import split
from insenv.mavlink.wire.signing import AHEAD_TICKS, EPOCH_UNIX_S, LEAD_TICKS, TICKS_PER_S, Verdict, read_key

m = dialect()
KEY = bytes(range(32))
OTHER_KEY = bytes(range(1, 33))
NOW_S = 1_800_000_000.0
POSIX = pytest.mark.skipif(os.name != "posix", reason="this system has no such permissions")


class Clock:
    def __init__(self, now: float = NOW_S) -> None:
        self.now = now

    def __call__(self) -> float:
        return self.now


def ticks(seconds: float) -> int:
    return round((seconds - EPOCH_UNIX_S) * TICKS_PER_S)


class Ground:
    """A ground tool that signs as pymavlink does."""

    def __init__(self, key: bytes = KEY, at_s: float = NOW_S, system: int = 255, link: int = 0) -> None:
        self.mav = m.MAVLink(None, srcSystem=system, srcComponent=190)
        self.mav.signing.secret_key = key
        self.mav.signing.sign_outgoing = True
        self.mav.signing.link_id = link
        self.mav.signing.timestamp = ticks(at_s)

    def frame(self, message: Any | None = None) -> bytes:
        return (message or command()).pack(self.mav)

    def at(self, seconds: float) -> bytes:
        self.mav.signing.timestamp = ticks(seconds)
        return self.frame()


def command() -> Any:
    return m.MAVLink_command_long_message(1, 1, m.MAV_CMD_COMPONENT_ARM_DISARM, 0, 1, 0, 0, 0, 0, 0, 0)


def unsigned(message: Any | None = None) -> bytes:
    return (message or command()).pack(m.MAVLink(None, srcSystem=255, srcComponent=190))


@pytest.fixture
def key_file(tmp_path: Path) -> Path:
    return key_in(tmp_path / "key", KEY)


def key_in(path: Path, content: bytes, mode: int = 0o600) -> Path:
    path.write_bytes(content)
    path.chmod(mode)
    return path


# --- the key -------------------------------------------------------------------------------------


@pytest.mark.parametrize("content", [KEY, KEY.hex().encode(), KEY.hex().upper().encode() + b"\n"], ids=["raw", "hex", "HEX"])
def test_keys_are_read(tmp_path: Path, content: bytes) -> None:
    assert read_key(key_in(tmp_path / "key", content)) == KEY


@pytest.mark.parametrize("content", [b"", KEY[:31], KEY + b"\n", KEY.hex().encode()[:63], b"z" * 64, KEY.hex().encode() * 2])
def test_keys_of_a_wrong_length(tmp_path: Path, content: bytes) -> None:
    with pytest.raises(InputError, match=f"{len(content)} bytes; must be 32 bytes or 64 hex digits"):
        read_key(key_in(tmp_path / "key", content))


def test_a_key_of_zeros_and_no_key(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="all zero"):
        read_key(key_in(tmp_path / "key", bytes(32)))
    with pytest.raises(InputError, match="file not found"):
        read_key(tmp_path / "none")
    with pytest.raises(InputError, match=r"regular file|cannot be read"):
        read_key(tmp_path)
    with pytest.raises(InputError, match="5 bytes, must be 32"):
        Signing(b"short")


@POSIX
@pytest.mark.parametrize("mode", [0o640, 0o604, 0o620, 0o602, 0o610, 0o644, 0o777])
def test_keys_that_others_may_read_or_write(tmp_path: Path, mode: int) -> None:
    path = key_in(tmp_path / "key", KEY, mode)
    with pytest.raises(InputError, match=f"{mode:04o}.*chmod 600"):
        read_key(path)
    path.chmod(0o400)
    assert read_key(path) == KEY


@POSIX
def test_only_the_owner_can_read_the_file_of_times(key_file: Path) -> None:
    Signing.from_key_file(key_file)
    assert Path(f"{key_file}.times").stat().st_mode & 0o077 == 0


@POSIX
@pytest.mark.skipif(os.name == "posix" and os.geteuid() == 0, reason="root may write anywhere")
def test_an_unwritable_folder(key_file: Path) -> None:
    key_file.parent.chmod(0o500)
    try:
        with pytest.raises(InputError, match="cannot be written"):
            Signing.from_key_file(key_file)
    finally:
        key_file.parent.chmod(0o700)


# --- with pymavlink ------------------------------------------------------------------------------


def test_pymavlink_accepts_our_signatures_and_we_accept_its(opened: Callable[..., Link]) -> None:
    vehicle = opened("udpin:127.0.0.1:0", signing=Signing(KEY))
    ground = opened(f"udpout:127.0.0.1:{vehicle.address.port}", signing=Signing(KEY, link=3), system=255, component=190)
    their = m.MAVLink(None)
    their.signing.secret_key = KEY
    their.signing.timestamp = ticks(time.time())
    for _ in range(300):  # past a sequence of 256
        frame = vehicle.send(m.MAVLink_heartbeat_message(11, 0, 0, 0, 4, 3))
        assert their.decode(bytearray(frame)).get_signed()
    frame = ground.send(command())
    assert their.decode(bytearray(frame)).get_link_id() == 3
    ((_, message),) = received(vehicle)
    assert message.get_type() == "COMMAND_LONG"
    signing = Signing(KEY)
    mine = Ground(at_s=time.time())
    assert all(signing.verify(mine.frame()) is Verdict.GOOD for _ in range(300))


def received(link: Link) -> list[Any]:
    for _ in range(1000):
        if got := link.receive():
            return got
        time.sleep(0.001)
    raise AssertionError(link.statistics)


# --- attacks -------------------------------------------------------------------------------------


def test_unsigned_and_wrongly_signed_commands() -> None:
    signing = Signing(KEY, clock=Clock())
    good = Ground().frame()
    assert signing.verify(unsigned()) is Verdict.UNSIGNED
    assert signing.verify(command().pack(m.MAVLink(None, srcSystem=255), force_mavlink1=True)) is Verdict.UNSIGNED
    assert signing.verify(Ground(OTHER_KEY).frame()) is Verdict.WRONGLY_SIGNED
    for at in range(10, len(good)):  # payload, checksum, link, time, hash
        broken = bytearray(good)
        broken[at] ^= 1
        assert signing.verify(bytes(broken)) is Verdict.WRONGLY_SIGNED
    assert signing.verify(good) is Verdict.GOOD


def test_a_removed_signed_flag() -> None:
    """Without signature and flag the checksum is wrong; with a corrected checksum the frame is unsigned."""
    good = Ground().frame()
    cut = bytearray(good[:-13])
    cut[2] = 0
    assert split(bytes(cut), Statistics())[0] == []
    checksum = m.x25crc(bytes(cut[1:-2]) + bytes((m.MAVLink_command_long_message.crc_extra,))).crc
    cut[-2:] = checksum.to_bytes(2, "little")
    (frame,) = split(bytes(cut), Statistics())[0]
    assert Signing(KEY, clock=Clock()).verify(frame) is Verdict.UNSIGNED


def test_one_forged_frame_does_not_lock_the_genuine_sender_out() -> None:
    """The fault of pymavlink 2.4: it stores a frame's time before it checks the hash."""
    signing = Signing(KEY, clock=Clock())
    ground = Ground()
    assert signing.verify(ground.frame()) is Verdict.GOOD
    forged = bytearray(ground.at(NOW_S + 30 * 365 * 86400))
    forged[-1] ^= 1
    for _ in range(3):
        assert signing.verify(bytes(forged)) is Verdict.WRONGLY_SIGNED
    assert signing.verify(ground.at(NOW_S + 0.1)) is Verdict.GOOD
    # nor before the first genuine frame
    fresh = Signing(KEY, clock=Clock())
    assert fresh.verify(bytes(forged)) is Verdict.WRONGLY_SIGNED
    assert fresh.verify(Ground().frame()) is Verdict.GOOD
    # pymavlink itself does lock the sender out
    their = m.MAVLink(None)
    their.signing.secret_key = KEY
    their.signing.timestamp = ticks(NOW_S)
    with pytest.raises(m.MAVError):
        their.decode(bytearray(forged))
    with pytest.raises(m.MAVError):
        their.decode(bytearray(Ground().frame()))


def test_forged_frames_change_neither_our_time_nor_the_file(key_file: Path) -> None:
    clock = Clock()
    signing = Signing.from_key_file(key_file, clock=clock)
    marks = Path(f"{key_file}.times")
    signing.verify(Ground().frame())
    before = marks.read_bytes()
    forger = Ground(OTHER_KEY, NOW_S + 3600)
    for system in range(1, 255):
        forger.mav.srcSystem = system
        assert signing.verify(forger.frame()) is Verdict.WRONGLY_SIGNED
    assert marks.read_bytes() == before
    frame = signing.signed(unsigned())
    assert int.from_bytes(frame[-12:-6], "little") <= ticks(NOW_S) + 1


def test_replay() -> None:
    clock = Clock()
    signing = Signing(KEY, clock=clock)
    ground = Ground()
    frames = [ground.frame() for _ in range(5)]
    assert signing.verify(frames[0]) is Verdict.GOOD
    assert signing.verify(frames[0]) is Verdict.REPLAYED
    assert signing.verify(frames[4]) is Verdict.GOOD
    assert [signing.verify(frame) for frame in frames] == [Verdict.REPLAYED] * 5  # late ones too
    clock.now += 3600
    assert signing.verify(frames[4]) is Verdict.REPLAYED
    assert signing.verify(Ground(at_s=NOW_S + 0.01).frame()) is Verdict.GOOD  # slow clocks of known senders are allowed


def test_other_streams_and_their_first_frames() -> None:
    clock = Clock()
    signing = Signing(KEY, clock=clock)
    old = Ground(at_s=NOW_S - 61).frame()
    assert signing.verify(old) is Verdict.STALE
    recent = Ground(at_s=NOW_S - 59).frame()
    assert signing.verify(recent) is Verdict.GOOD
    # each system and each link number has its own time
    assert signing.verify(Ground(at_s=NOW_S - 30, system=254).frame()) is Verdict.GOOD
    assert signing.verify(Ground(at_s=NOW_S - 40, link=1).frame()) is Verdict.GOOD
    assert signing.verify(Ground(at_s=NOW_S - 59.5).frame()) is Verdict.REPLAYED


def test_a_recorded_frame_of_another_stream_number_needs_the_key() -> None:
    """Moving a recorded frame to a new stream invalidates its hash."""
    signing = Signing(KEY, clock=Clock())
    good = Ground().frame()
    for at, value in ((5, 7), (6, 7), (len(good) - 13, 7)):
        moved = bytearray(good)
        moved[at] = value
        checksum = m.x25crc(bytes(moved[1:-15]) + bytes((m.MAVLink_command_long_message.crc_extra,))).crc
        moved[-15:-13] = checksum.to_bytes(2, "little")
        assert split(bytes(moved), Statistics())[0] == [bytes(moved)]
        assert signing.verify(bytes(moved)) is Verdict.WRONGLY_SIGNED


def test_our_own_frames_reflected() -> None:
    clock = Clock()
    signing = Signing(KEY, clock=clock)
    own = signing.signed(m.MAVLink_heartbeat_message(11, 0, 0, 0, 4, 3).pack(m.MAVLink(None, srcSystem=1, srcComponent=1)))
    flagged = bytearray(own[:-13])
    flagged[2] = 1
    own = signing.signed(bytes(flagged))
    assert signing.verify(own, own=(1, 1)) is Verdict.REFLECTED


def test_a_sender_with_a_wrong_clock_locks_nobody_out_not_even_itself(key_file: Path) -> None:
    clock = Clock()
    signing = Signing.from_key_file(key_file, clock=clock)
    year = 365 * 86400
    for ahead in (5 * year, 50 * year, LEAD_TICKS / TICKS_PER_S + 1):
        assert signing.verify(Ground(at_s=NOW_S + ahead).frame()) is Verdict.EARLY
    assert signing.verify(Ground().frame()) is Verdict.GOOD  # the same one, with its clock set right
    # up to a day, such as a wrong time zone, is accepted; it keeps its stream out until then, and others not
    zone = Ground(at_s=NOW_S + 12 * 3600, system=254)
    assert signing.verify(zone.frame()) is Verdict.GOOD
    assert signing.verify(Ground(system=254).frame()) is Verdict.REPLAYED
    assert signing.verify(Ground(at_s=NOW_S + 1, system=253).frame()) is Verdict.GOOD
    clock.now += 12 * 3600 + 1
    assert signing.verify(Ground(at_s=clock.now, system=254).frame()) is Verdict.GOOD
    assert int.from_bytes(signing.signed(unsigned())[-12:-6], "little") <= ticks(clock.now) + LEAD_TICKS + 1


def test_our_times_follow_the_clock_and_always_increase() -> None:
    clock = Clock()
    signing = Signing(KEY, clock=clock)

    def time_of() -> int:
        return int.from_bytes(signing.signed(unsigned())[-12:-6], "little")

    assert time_of() == ticks(NOW_S)
    assert [time_of() - ticks(NOW_S) for _ in range(3)] == [1, 2, 3]
    clock.now += 1
    assert time_of() == ticks(NOW_S + 1)
    clock.now -= 1000  # set back
    assert time_of() == ticks(NOW_S + 1) + 1
    # a ground tool whose clock is ahead would reject our first frame: our times follow it
    assert signing.verify(Ground(at_s=NOW_S + 3600).frame()) is Verdict.GOOD
    assert time_of() == ticks(NOW_S + 3600) + 1


def test_streams_are_bounded_and_old_ones_make_room(monkeypatch: pytest.MonkeyPatch, key_file: Path) -> None:
    monkeypatch.setattr("insenv.mavlink.wire.signing.MOST_STREAMS", 4)
    clock = Clock()
    signing = Signing.from_key_file(key_file, clock=clock)
    flood = [Ground(system=i).frame() for i in range(2, 8)]
    assert [signing.verify(frame) for frame in flood] == [Verdict.GOOD] * 4 + [Verdict.STALE] * 2
    assert signing.verify(Ground(at_s=NOW_S + 1, system=2).frame()) is Verdict.GOOD
    signing.store()
    for restarted in (False, True):
        clock.now += 62
        if restarted:
            signing = Signing.from_key_file(key_file, clock=clock)
        # a new ground station gets a place, and what has made room is not accepted again
        system = 100 + restarted
        assert signing.verify(Ground(at_s=clock.now, system=system).frame()) is Verdict.GOOD
        assert [signing.verify(frame) for frame in flood] == [Verdict.REPLAYED] * 6
        assert len(signing._last) <= 4
    # nor if our clock is set back, before a restart or after a crash
    clock.now = NOW_S + 2
    assert [signing.verify(frame) for frame in flood] == [Verdict.REPLAYED] * 6
    again = Signing.from_key_file(key_file, clock=clock)
    assert [again.verify(frame) for frame in flood] == [Verdict.REPLAYED] * 6


def test_the_file_is_written_once_a_second_for_any_number_of_streams(key_file: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    clock = Clock()
    signing = Signing.from_key_file(key_file, clock=clock)
    written = []
    write = Signing._write
    monkeypatch.setattr(Signing, "_write", lambda self, path: (written.append(path), write(self, path))[1])
    believed = []
    for step in range(500):  # 5 s; a new stream at each step, and each continues
        clock.now = NOW_S + step * 0.01
        for system in (step % 250 + 1, (step - 1) % 250 + 1):
            believed.append(Ground(at_s=clock.now + 1e-4 * system, system=system, link=step // 250).frame())
            signing.verify(believed[-1])
    assert len(signing._last) > 490 and len(written) <= 12
    # after a crash none of all these frames is accepted again
    crashed = Signing.from_key_file(key_file, clock=clock)
    assert {crashed.verify(frame) for frame in believed} == {Verdict.REPLAYED}


# --- restarts ------------------------------------------------------------------------------------


@pytest.mark.parametrize("orderly", [True, False])
def test_nothing_is_accepted_twice_across_a_restart(key_file: Path, orderly: bool) -> None:
    clock = Clock()
    ground = Ground()
    believed = []
    for start in range(4):
        signing = Signing.from_key_file(key_file, clock=clock)
        assert [signing.verify(frame) for frame in believed] == [Verdict.REPLAYED] * len(believed)
        for step in range(30):
            clock.now += 0.07
            frame = ground.at(clock.now)
            verdict = signing.verify(frame)
            # after a crash a sender that continues waits for the mark, one second at most
            assert verdict is Verdict.GOOD or (not orderly and start and step * 0.07 < AHEAD_TICKS / TICKS_PER_S)
            if verdict is Verdict.GOOD:
                believed.append(frame)
        if orderly:
            signing.store()
    assert len(believed) == 120 if orderly else len(believed) > 70


def test_no_signing_time_is_used_twice_even_if_the_clock_is_set_back(key_file: Path) -> None:
    clock = Clock()
    times = []
    for _ in range(3):
        signing = Signing.from_key_file(key_file, clock=clock)
        times += [int.from_bytes(signing.signed(unsigned())[-12:-6], "little") for _ in range(50)]
        clock.now -= 600
    assert all(a < b for a, b in itertools.pairwise(times))


def test_a_broken_file_of_times_is_refused(key_file: Path) -> None:
    for text in (
        "",
        "{}",
        '{"own": 1, "streams": []}',
        '{"own": -1, "streams": {}}',
        '{"own": 1, "streams": {"1 2": 3}}',
        "\xff",
    ):
        Path(f"{key_file}.times").write_text(text, encoding="latin-1")
        with pytest.raises(InputError, match="not a valid file of signing times"):
            Signing.from_key_file(key_file)


def test_without_stored_marks_frames_are_rejected_but_ours_are_sent(key_file: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    clock = Clock()
    signing = Signing.from_key_file(key_file, clock=clock)

    def full(*_: object) -> None:
        raise OSError(28, "No space left on device")

    with monkeypatch.context() as patch:
        patch.setattr("os.replace", full)
        frame = Ground().frame()
        assert signing.verify(frame) is Verdict.STALE
        assert len(signing.signed(unsigned())) == len(unsigned()) + 13
        assert signing.unstored == 2
    assert signing.verify(frame) is Verdict.GOOD
    assert sorted(path.name for path in key_file.parent.iterdir()) == ["key", "key.times"]


# --- over a link ---------------------------------------------------------------------------------


def test_a_signed_link_rejects_and_counts_everything_else(opened: Callable[..., Link], key_file: Path) -> None:
    import socket

    clock = Clock()
    vehicle = opened("udpin:127.0.0.1:0", signing=Signing.from_key_file(key_file, clock=clock))
    target = ("127.0.0.1", vehicle.address.port)
    ground = Ground()
    frames = [ground.frame() for _ in range(3)]
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as attacker, socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as tool:
        for bad in (unsigned(), Ground(OTHER_KEY).frame(), Ground(at_s=NOW_S - 3600, system=254).frame()):
            attacker.sendto(bad, target)
        tool.sendto(frames[0], target)
        assert [message.get_type() for _, message in received(vehicle)] == ["COMMAND_LONG"]
        attacker.sendto(frames[0], target)
        tool.sendto(frames[1], target)
        received(vehicle)
        # a sender without the key becomes no peer
        assert [peer.key for peer in vehicle.peers] == [("127.0.0.1", tool.getsockname()[1])]
    counts = vehicle.statistics
    assert (counts.unsigned, counts.wrongly_signed, counts.stale, counts.replayed) == (1, 1, 1, 1)
    assert counts.received_messages == 2


def test_the_stream_signs(key_file: Path, tmp_path: Path) -> None:
    """`insenv stream` with a key: a tool with the same key accepts everything, one with another key nothing."""
    import socket

    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as tool:
        tool.bind(("127.0.0.1", 0))
        tool.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 1 << 20)
        to = f"udpout:127.0.0.1:{tool.getsockname()[1]}"
        begun = ticks(time.time())
        arguments = ("--to", to, "--signing-key-file", key_file, "--speed", "0", "--duration", "0.2", "--json")
        status, out, err = call("stream", "ship-swaying", *arguments)
        assert status == 0, err
        assert strict(out)["link"]["sent_messages"] > 20
        tool.settimeout(1)
        believed = Signing(KEY)
        frames = []
        tool.setblocking(False)
        while True:
            try:
                frames.append(tool.recv(4096))
            except BlockingIOError:
                break
    assert len(frames) > 20
    assert {believed.verify(frame) for frame in frames} == {Verdict.GOOD}
    assert {Signing(OTHER_KEY).verify(frame) for frame in frames} == {Verdict.WRONGLY_SIGNED}
    assert int.from_bytes(frames[0][-12:-6], "little") >= begun
    status, _, err = call("stream", "ship-swaying", "--to", to, "--signing-key-file", tmp_path / "none")
    assert status == 2 and "file not found" in err
