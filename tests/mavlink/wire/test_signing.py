"""Signing: pymavlink and insenv accept each other's signatures, and every known attack is tried."""

import os
import time
from pathlib import Path

import pytest
from pymavlink.dialects.v20 import common as m
from streamed_vehicle import Clock, heartbeat, until

from insenv.base.errors import InputError
from insenv.mavlink.wire import Signing
from insenv.mavlink.wire.signing import AHEAD_TICKS, EPOCH_UNIX_S, MAX_LEAD_TICKS, TICKS_PER_S, Verdict, read_key

KEY, OTHER_KEY = bytes(range(32)), bytes(range(1, 33))
NOW_S = 1_800_000_000.0
POSIX = pytest.mark.skipif(os.name != "posix", reason="this system has no such permissions")
GOOD, REPLAYED, STALE, WRONGLY_SIGNED = Verdict.GOOD, Verdict.REPLAYED, Verdict.STALE, Verdict.WRONGLY_SIGNED


def ticks(seconds):
    return round((seconds - EPOCH_UNIX_S) * TICKS_PER_S)


def time_of(frame):
    return int.from_bytes(frame[-12:-6], "little")


def command():
    return m.MAVLink_command_long_message(1, 1, m.MAV_CMD_COMPONENT_ARM_DISARM, 0, 1, 0, 0, 0, 0, 0, 0)


def unsigned():
    return command().pack(m.MAVLink(None, srcSystem=255, srcComponent=190))


class Ground:
    """A ground tool that signs as pymavlink does."""

    def __init__(self, key=KEY, at_s=NOW_S, system=255, link=0):
        self.mav = m.MAVLink(None, srcSystem=system, srcComponent=190)
        self.mav.signing.secret_key = key
        self.mav.signing.sign_outgoing = True
        self.mav.signing.link_id = link
        self.mav.signing.timestamp = ticks(at_s)

    def frame(self):
        return command().pack(self.mav)

    def at(self, seconds):
        self.mav.signing.timestamp = ticks(seconds)
        return self.frame()


@pytest.fixture
def clock():
    return Clock(NOW_S)


@pytest.fixture
def signing(clock):
    return Signing(KEY, clock=clock)


@pytest.fixture
def key_file(tmp_path):
    return key_in(tmp_path / "key", KEY)


def key_in(path, content, mode=0o600):
    path.write_bytes(content)
    path.chmod(mode)
    return path


def test_keys_are_read(tmp_path):
    for content in (KEY, KEY.hex().encode(), KEY.hex().upper().encode() + b"\n"):
        assert read_key(key_in(tmp_path / "key", content)) == KEY
    for content in (b"", KEY[:31], KEY + b"\n", b"z" * 64):
        with pytest.raises(InputError, match=f"{len(content)} bytes; must be 32 bytes or 64 hex digits"):
            read_key(key_in(tmp_path / "key", content))
    for path, message in ((key_in(tmp_path / "key", bytes(32)), "all zero"), (tmp_path / "none", "file not found")):
        with pytest.raises(InputError, match=message):
            read_key(path)


@POSIX
def test_only_the_owner_may_read_or_write_the_key_and_the_file_of_times(tmp_path, key_file):
    for mode in (0o640, 0o604, 0o620, 0o602):
        with pytest.raises(InputError, match=f"{mode:04o}.*chmod 600"):
            read_key(key_in(tmp_path / "key", KEY, mode))
    key_file.chmod(0o400)
    assert read_key(key_file) == KEY
    Signing.from_key_file(key_file)
    assert Path(f"{key_file}.times").stat().st_mode & 0o077 == 0


def test_pymavlink_accepts_our_signatures_and_we_accept_its(opened):
    vehicle = opened("udpin:127.0.0.1:0", signing=Signing(KEY))
    ground = opened(f"udpout:127.0.0.1:{vehicle.address.port}", signing=Signing(KEY, link=3), system=255, component=190)
    their, signing, mine = m.MAVLink(None), Signing(KEY), Ground(at_s=time.time())
    their.signing.secret_key = KEY
    their.signing.timestamp = ticks(time.time())
    for _ in range(300):  # past a sequence of 256
        assert their.decode(bytearray(vehicle.send(heartbeat()))).get_signed()
        assert signing.verify(mine.frame()) is GOOD
    assert their.decode(bytearray(ground.send(command()))).get_link_id() == 3
    ((_, message),) = until(vehicle, bool)
    assert message.get_type() == "COMMAND_LONG"


def test_unsigned_and_wrongly_signed_commands(signing):
    good = Ground().frame()
    assert signing.verify(unsigned()) is Verdict.UNSIGNED
    assert signing.verify(command().pack(m.MAVLink(None, srcSystem=255), force_mavlink1=True)) is Verdict.UNSIGNED
    assert signing.verify(Ground(OTHER_KEY).frame()) is WRONGLY_SIGNED
    for at in range(4, len(good)):  # sequence, system, component, payload, checksum, link, time, hash
        broken = bytearray(good)
        broken[at] ^= 1
        assert signing.verify(bytes(broken)) is WRONGLY_SIGNED
    assert signing.verify(good) is GOOD


@pytest.mark.parametrize("first", [True, False])
def test_forged_frames_lock_no_genuine_sender_out_and_change_neither_our_time_nor_the_file(key_file, clock, first):
    """The fault of pymavlink 2.4: it stores a frame's time before it checks the hash."""
    signing, ground = Signing.from_key_file(key_file, clock=clock), Ground()
    if first:
        assert signing.verify(ground.frame()) is GOOD
    before = Path(f"{key_file}.times").read_bytes()
    for ahead in (3600, 30 * 365 * 86400):
        forger = Ground(OTHER_KEY, NOW_S + ahead)
        for system in range(1, 256):
            forger.mav.srcSystem = system
            assert signing.verify(forger.frame()) is WRONGLY_SIGNED
    assert Path(f"{key_file}.times").read_bytes() == before
    assert time_of(signing.signed(unsigned())) <= ticks(NOW_S) + 1
    assert signing.verify(ground.at(NOW_S + 0.1)) is GOOD


def test_replayed_late_and_reflected_frames(signing, clock):
    ground = Ground()
    frames = [ground.frame() for _ in range(5)]
    assert [signing.verify(frames[n]) for n in (0, 0, 4)] == [GOOD, REPLAYED, GOOD]
    assert [signing.verify(frame) for frame in frames] == [REPLAYED] * 5  # late ones too
    clock.now += 3600
    assert signing.verify(frames[4]) is REPLAYED
    assert signing.verify(Ground(at_s=NOW_S + 0.01).frame()) is GOOD  # slow clocks of known senders are allowed
    own = bytearray(m.MAVLink_heartbeat_message(11, 0, 0, 0, 4, 3).pack(m.MAVLink(None, srcSystem=1, srcComponent=1)))
    own[2] = 1
    assert signing.verify(signing.signed(bytes(own)), ours=(1, 1)) is Verdict.REFLECTED


def test_each_system_and_each_link_number_has_its_own_time(signing):
    given = [{"at_s": NOW_S - 61}, {"at_s": NOW_S - 59}, {"at_s": NOW_S - 30, "system": 254}, {"at_s": NOW_S - 40, "link": 1}]
    verdicts = [signing.verify(Ground(**each).frame()) for each in (*given, {"at_s": NOW_S - 59.5})]
    assert verdicts == [STALE, GOOD, GOOD, GOOD, REPLAYED]


def test_a_sender_with_a_wrong_clock_locks_nobody_out_not_even_itself(key_file, clock):
    signing = Signing.from_key_file(key_file, clock=clock)
    year = 365 * 86400
    for ahead in (5 * year, 50 * year, MAX_LEAD_TICKS / TICKS_PER_S + 1):
        assert signing.verify(Ground(at_s=NOW_S + ahead).frame()) is Verdict.EARLY
    assert signing.verify(Ground().frame()) is GOOD  # the same one, with its clock set right
    # up to a day, such as a wrong time zone, is accepted; it keeps its stream out until then, and others not
    assert signing.verify(Ground(at_s=NOW_S + 12 * 3600, system=254).frame()) is GOOD
    assert signing.verify(Ground(system=254).frame()) is REPLAYED
    assert signing.verify(Ground(at_s=NOW_S + 1, system=253).frame()) is GOOD
    clock.now += 12 * 3600 + 1
    assert signing.verify(Ground(at_s=clock.now, system=254).frame()) is GOOD
    assert time_of(signing.signed(unsigned())) <= ticks(clock.now) + MAX_LEAD_TICKS + 1


def test_our_times_follow_the_clock_and_always_increase(key_file, clock):
    signing = Signing.from_key_file(key_file, clock=clock)

    def ours():
        return time_of(signing.signed(unsigned()))

    assert [ours() - ticks(NOW_S) for _ in range(4)] == [0, 1, 2, 3]
    clock.now += 1
    assert ours() == ticks(NOW_S + 1)
    clock.now -= 1000  # set back
    assert ours() == ticks(NOW_S + 1) + 1
    # a ground tool whose clock is ahead would reject our first frame: our times follow it
    assert signing.verify(Ground(at_s=NOW_S + 3600).frame()) is GOOD
    assert ours() == ticks(NOW_S + 3600) + 1
    # nor is a time used twice after a crash
    assert time_of(Signing.from_key_file(key_file, clock=clock).signed(unsigned())) > ticks(NOW_S + 3600) + 1


def test_streams_are_bounded_and_old_ones_make_room(monkeypatch, key_file, clock):
    monkeypatch.setattr("insenv.mavlink.wire.signing.MAX_STREAMS", 4)
    signing = Signing.from_key_file(key_file, clock=clock)
    flood = [Ground(system=i).frame() for i in range(2, 8)]
    assert [signing.verify(frame) for frame in flood] == [GOOD] * 4 + [STALE] * 2
    assert signing.verify(Ground(at_s=NOW_S + 1, system=2).frame()) is GOOD
    signing.store()
    for restarted in (False, True):
        clock.now += 62
        if restarted:
            signing = Signing.from_key_file(key_file, clock=clock)
        # a new ground station gets a place, and what has made room is not accepted again
        assert signing.verify(Ground(at_s=clock.now, system=100 + restarted).frame()) is GOOD
        assert [signing.verify(frame) for frame in flood] == [REPLAYED] * 6
        assert len(signing._last) <= 4
    # nor if our clock is set back, before a restart or after a crash
    clock.now = NOW_S + 2
    for each in (signing, Signing.from_key_file(key_file, clock=clock)):
        assert [each.verify(frame) for frame in flood] == [REPLAYED] * 6


def test_the_file_is_written_once_a_second_for_any_number_of_streams(key_file, monkeypatch, clock):
    signing = Signing.from_key_file(key_file, clock=clock)
    written, write = [], Signing._write
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
    assert {crashed.verify(frame) for frame in believed} == {REPLAYED}


@pytest.mark.parametrize("orderly", [True, False])
def test_nothing_is_accepted_twice_across_a_restart(key_file, orderly, clock):
    ground, believed = Ground(), []
    for start in range(4):
        signing = Signing.from_key_file(key_file, clock=clock)
        assert [signing.verify(frame) for frame in believed] == [REPLAYED] * len(believed)
        for step in range(30):
            clock.now += 0.07
            frame = ground.at(clock.now)
            verdict = signing.verify(frame)
            # after a crash a sender that continues waits for the mark, one second at most
            assert verdict is GOOD or (not orderly and start and step * 0.07 < AHEAD_TICKS / TICKS_PER_S)
            believed += [frame] * (verdict is GOOD)
        if orderly:
            signing.store()
    assert len(believed) == 120 if orderly else len(believed) > 70


@pytest.mark.parametrize("text", ["", '{"own": -1, "streams": {}}', '{"own": 1, "streams": {"1 2": 3}}', "\xff"])
def test_a_broken_file_of_times_is_refused(key_file, text):
    Path(f"{key_file}.times").write_text(text, encoding="latin-1")
    with pytest.raises(InputError, match="not a valid file of signing times"):
        Signing.from_key_file(key_file)


def test_without_stored_marks_frames_are_rejected_but_ours_are_sent(key_file, monkeypatch, clock):
    signing, frame = Signing.from_key_file(key_file, clock=clock), Ground().frame()

    def full(*_):
        raise OSError(28, "No space left on device")

    with monkeypatch.context() as patch:
        patch.setattr("os.replace", full)
        assert signing.verify(frame) is STALE
        assert len(signing.signed(unsigned())) == len(unsigned()) + 13
        assert signing.unstored == 2
    assert signing.verify(frame) is GOOD
    assert sorted(path.name for path in key_file.parent.iterdir()) == ["key", "key.times"]


def test_a_signed_link_rejects_and_counts_everything_else(opened, sockets, key_file, clock):
    vehicle = opened("udpin:127.0.0.1:0", signing=Signing.from_key_file(key_file, clock=clock))
    ground = Ground()
    frames = [ground.frame() for _ in range(2)]
    attacker, tool = sockets(to=vehicle.address.port), sockets(to=vehicle.address.port)
    for bad in (unsigned(), Ground(OTHER_KEY).frame(), Ground(at_s=NOW_S - 3600, system=254).frame()):
        attacker.send(bad)
    tool.send(frames[0])
    assert [message.get_type() for _, message in until(vehicle, bool)] == ["COMMAND_LONG"]
    attacker.send(frames[0])
    tool.send(frames[1])
    until(vehicle, bool)
    # a sender without the key becomes no peer
    assert [peer.key for peer in vehicle.peers] == [tool.getsockname()]
    counts = vehicle.statistics
    assert (counts.unsigned, counts.wrongly_signed, counts.stale, counts.replayed) == (1, 1, 1, 1)
    assert counts.received_messages == 2
