"""`insenv stream --lockstep`: the simulated vehicle in lockstep with an autopilot."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING, Any

from insenv.errors import InputError

if TYPE_CHECKING:
    from insenv.mavlink import Vehicle
    from insenv.mavlink.lockstep import Progress

_CHUNK = 20


def lockstep(
    scenario: str,
    estimator: str | None,
    *,
    kind: str,
    to: str | None,
    seed: int | None,
    duration_s: float | None,
    tlog: Path | None,
    rates: Sequence[str],
    as_json: bool,
) -> None:
    """Run in lockstep until the duration is over or Ctrl-C, and print the counts."""
    from insenv.cli.output import print_json, print_line, quiet_warnings, working
    from insenv.cli.stream import checked_duration
    from insenv.mavlink import Vehicle
    from insenv.mavlink.lockstep import px4_rates
    from insenv.mavlink.messages import parse_rates
    from insenv.scenario import load

    loaded = load(scenario)
    duration = checked_duration(duration_s)
    if kind != "px4" and (tlog is not None or rates):
        option = "--rate" if tlog is None else "--tlog"
        raise InputError(f"{option}: ArduPilot's JSON interface has no MAVLink; allowed with --lockstep px4")
    chosen = {**(px4_rates(loaded.rate_hz) if kind == "px4" else {}), **parse_rates(list(rates))}
    with ExitStack() as stack:
        stack.enter_context(quiet_warnings())
        vehicle = Vehicle(loaded, estimator, seed=seed, rates=chosen, speed=0.0)
        run, address = _prepared(stack, kind, vehicle, to, tlog)
        progress = stack.enter_context(working(f"lockstep with {kind} on {address}"))
        begun, interrupted = time.monotonic(), False
        if sys.stderr.isatty():
            print_line(f"waiting for {kind} on {address}; Ctrl-C ends", stderr=True)
        total = None if duration is None else max(1, round(duration / vehicle.simulation.interval))
        done: Progress | None = None
        try:
            while total is None or vehicle.simulation.samples < total:
                left = _CHUNK if total is None else min(_CHUNK, total - vehicle.simulation.samples)
                done = run(left)
                if total is not None:
                    progress(vehicle.simulation.samples, total)
        except KeyboardInterrupt:
            interrupted = True
        wall = time.monotonic() - begun
    summary = {
        "scenario": loaded.name, "estimator": vehicle.simulation.estimator.id, "state": vehicle.view.state,
        "lockstep": kind, "address": address, "simulated_s": vehicle.simulation.time, "wall_s": wall,
        "interrupted": interrupted, "progress": {} if done is None else dict(vars(done)),
        "tlog": None if tlog is None else str(tlog),
    }  # fmt: skip
    if as_json:
        print_json(summary)
        return
    print_line(f"{loaded.name}: {vehicle.simulation.time:.1f} s simulated in lockstep with {kind} in {wall:.1f} s")
    if done is not None:
        print_line(", ".join(f"{name} {count}" for name, count in vars(done).items()))


def _prepared(
    stack: ExitStack, kind: str, vehicle: Vehicle, to: str | None, tlog: Path | None
) -> tuple[Callable[[int], Progress], str]:
    """The function that advances by a number of steps, and the address that is listened on."""
    from insenv.mavlink.lockstep import ArduPilotLockstep, Px4Lockstep, ardupilot, moving, px4, steering

    if kind == "px4":
        messages = vehicle.step if tlog is None else _recorded(stack, vehicle, tlog)
        interval, act = vehicle.simulation.interval, steering(vehicle, px4.CHANNELS)
        simulator = stack.enter_context(Px4Lockstep(messages, interval, act, address=to or px4.ADDRESS))
        return simulator.run, str(simulator.link.address)
    act = steering(vehicle, ardupilot.CHANNELS)
    json_simulator = stack.enter_context(ArduPilotLockstep(moving(vehicle), act, address=to or ardupilot.ADDRESS))
    return json_simulator.run, str(json_simulator.address)


def _recorded(stack: ExitStack, vehicle: Vehicle, tlog: Path) -> Callable[[], list[Any]]:
    """The vehicle's step, with its messages written to a log that has a sequence of its own."""
    from insenv.mavlink.lockstep.px4 import COMPONENT
    from insenv.mavlink.wire import TlogWriter, dialect

    recorder = stack.enter_context(TlogWriter(tlog))
    packer = dialect().MAVLink(None, 1, COMPONENT)

    def step() -> list[Any]:
        messages = vehicle.step()
        for message in messages:
            recorder.write(vehicle.view.unix_us, bytes(message.pack(packer)))
            packer.seq = (packer.seq + 1) % 256
        return messages

    return step
