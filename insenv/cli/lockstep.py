"""`insenv stream --lockstep`: the simulated vehicle in lockstep with an autopilot."""

from __future__ import annotations

import sys
import time
from collections.abc import Sequence
from contextlib import ExitStack
from math import degrees
from pathlib import Path
from typing import TYPE_CHECKING, Any

from insenv.base.errors import InputError

if TYPE_CHECKING:
    from insenv.mavlink import Vehicle
    from insenv.mavlink.lockstep.contract import Lockstep, Messages

_CHUNK = 20


def lockstep(
    scenario: str,
    estimator: str | None,
    *,
    kind: str,
    to: str | None,
    seed: int | None,
    speed: float | None,
    duration_s: float | None,
    tlog: Path | None,
    rates: Sequence[str],
    as_json: bool,
) -> None:
    """Run in lockstep until the duration is over or an end is requested, and print the counts.

    speed: None is 1 for PX4, which has no pace of its own, and 0 for ArduPilot, which keeps that of its --speedup.
    """
    from insenv.cli.interruptions import ending, written
    from insenv.cli.output import print_json, print_line, working
    from insenv.cli.stream import checked_duration
    from insenv.mavlink import Vehicle
    from insenv.mavlink.lockstep import px4_rates
    from insenv.mavlink.messages import parse_rates
    from insenv.mavlink.vehicle import checked_speed
    from insenv.scenario import load

    loaded = load(scenario)
    duration = checked_duration(duration_s)
    pace = checked_speed(speed if speed is not None else 1.0 if kind == "px4" else 0.0)
    if kind != "px4" and (tlog is not None or rates):
        option = "--rate" if tlog is None else "--tlog"
        raise InputError(f"{option}: ArduPilot's JSON interface has no MAVLink; allowed with --lockstep px4")
    chosen = {**(px4_rates(loaded.rate_hz) if kind == "px4" else {}), **parse_rates(list(rates), loaded.rate_hz)}
    with ending() as request:
        with ExitStack() as stack:
            vehicle = Vehicle(loaded, estimator, seed=seed, rates=chosen, speed=0.0, **_as_simulator(kind))
            simulator, address = _prepared(stack, kind, vehicle, to, tlog, pace)
            progress = stack.enter_context(working(f"lockstep with {kind} on {address}"))
            if sys.stderr.isatty():
                print_line(f"waiting for {kind} on {address}; Ctrl-C ends", stderr=True)
                if kind != "px4":
                    print_line(f"start it with --home={home_option(vehicle)}", stderr=True)
            total = None if duration is None else max(1, round(duration / vehicle.simulation.interval))
            begun = time.monotonic()
            request.orderly = True
            while not request() and (total is None or vehicle.simulation.samples < total):
                left = _CHUNK if total is None else min(_CHUNK, total - vehicle.simulation.samples)
                simulator.run(left, request)
                if total is not None:
                    progress(vehicle.simulation.samples, total)
            wall = time.monotonic() - begun
        summary = {
            "scenario": loaded.name, "estimator": vehicle.simulation.estimator.id, "state": vehicle.view.state,
            "lockstep": kind, "address": address, "simulated_s": vehicle.simulation.time, "wall_s": wall,
            "interrupted": request(), "progress": dict(vars(simulator.progress)),
            "tlog": None if tlog is None else str(tlog),
        }  # fmt: skip
        written(lambda: print_json(summary) if as_json else _print_summary(summary), request)


def _print_summary(summary: dict[str, Any]) -> None:
    from insenv.cli.output import print_line

    simulated, wall = summary["simulated_s"], summary["wall_s"]
    print_line(f"{summary['scenario']}: {simulated:.1f} s simulated in lockstep with {summary['lockstep']} in {wall:.1f} s")
    print_line(", ".join(f"{name} {count}" for name, count in summary["progress"].items()))
    if summary["tlog"]:
        print_line(f"written: {summary['tlog']}")


def _as_simulator(kind: str) -> dict[str, Any]:
    """How the vehicle presents itself to the autopilot: PX4 is component 1 of the same system, and has units of its own."""
    from insenv.mavlink.lockstep.px4 import COMPONENT

    return {"component": COMPONENT, "hil_acceleration": "mm/s^2"} if kind == "px4" else {}


def home_option(vehicle: Vehicle) -> str:
    """Home as ArduPilot's ``--home`` takes it: latitude, longitude (deg), height (m), heading (deg)."""
    latitude, longitude, height = vehicle.view.home
    heading = degrees(vehicle.simulation.plant.knowledge.heading) % 360.0
    return f"{degrees(latitude):.7f},{degrees(longitude):.7f},{height - vehicle.view.undulation:.2f},{heading:.1f}"


def _prepared(
    stack: ExitStack, kind: str, vehicle: Vehicle, to: str | None, tlog: Path | None, speed: float
) -> tuple[Lockstep, str]:
    """The simulator's side, and the address that it listens on."""
    from insenv.mavlink.commands import answers
    from insenv.mavlink.lockstep import ArduPilotLockstep, Px4Lockstep, ardupilot, moving, px4, px4_messages, steering

    interval = vehicle.simulation.interval
    if kind == "px4":
        step = px4_messages(vehicle)
        messages = step if tlog is None else _recorded(stack, vehicle, step, tlog)
        px4_simulator = stack.enter_context(
            Px4Lockstep(
                messages, interval, steering(vehicle, px4.CHANNELS), answer=lambda message: answers(vehicle, message),
                address=to or px4.ADDRESS, speed=speed,
            )
        )  # fmt: skip
        return px4_simulator, str(px4_simulator.link.address)
    act = steering(vehicle, ardupilot.CHANNELS)
    json_simulator = stack.enter_context(
        ArduPilotLockstep(moving(vehicle), act, address=to or ardupilot.ADDRESS, interval=interval, speed=speed)
    )
    return json_simulator, str(json_simulator.address)


def _recorded(stack: ExitStack, vehicle: Vehicle, simulate: Messages, tlog: Path) -> Messages:
    """The vehicle's step, with its messages written to a log that begins with its parameters and has a sequence of its own."""
    from insenv.mavlink.commands import parameter_frames
    from insenv.mavlink.wire import TlogWriter, dialect

    recorder = stack.enter_context(TlogWriter(tlog))
    packer = dialect().MAVLink(None, vehicle.view.system, vehicle.view.component)
    for frame in parameter_frames(vehicle):
        recorder.write(vehicle.view.unix_us, frame)
    packer.seq = len(vehicle.parameters) % 256

    def step() -> Sequence[Any]:
        messages = simulate()
        for message in messages:
            recorder.write(vehicle.view.unix_us, bytes(message.pack(packer)))
            packer.seq = (packer.seq + 1) % 256
        return messages

    return step
