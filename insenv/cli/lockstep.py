"""`insenv stream --lockstep`: the simulated vehicle in lockstep with an autopilot."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack
from math import degrees
from pathlib import Path
from typing import TYPE_CHECKING, Any

from insenv.base.errors import InputError

if TYPE_CHECKING:
    from insenv.mavlink import Vehicle
    from insenv.mavlink.lockstep import ArduPilotLockstep, Px4Lockstep
    from insenv.scenario import Scenario

_CHUNK = 20


def lockstep(
    scenario: Scenario,
    estimator: str | None,
    *,
    kind: str,
    to: str | None,
    seed: int | None,
    speed: float | None,
    duration_s: float | None,
    tlog: Path | None,
    rates: Sequence[str],
    parameters: Path | None,
    as_json: bool,
) -> None:
    """Run in lockstep until the duration is over or an end is requested, and print the counts.

    kind: a key of `AUTOPILOTS`.  speed: None is 1 for PX4, which has no pace of its own, and 0 for ArduPilot, which keeps that
    of its --speedup.  parameters: where those for ArduPilot are written (`insenv.mavlink.lockstep.ardupilot.PARAMETERS`).
    """
    from insenv.base.output import check_output_file, write_unless_other
    from insenv.cli.output import is_quiet, print_json, print_line, working
    from insenv.cli.signals import ending, written
    from insenv.mavlink.lockstep.ardupilot import parameter_file

    if parameters is not None:
        check_output_file(parameters)
    with ending() as request:
        with ExitStack() as stack:
            vehicle, simulator, address = AUTOPILOTS[kind](
                stack, scenario, to, speed, tlog, rates, estimator=estimator, seed=seed
            )
            if parameters is not None:  # nothing is written for a call that is refused
                write_unless_other(parameters, parameter_file().encode("ascii"))
            progress = stack.enter_context(working(f"lockstep with {kind} on {address}"))
            if sys.stderr.isatty() and not is_quiet():
                print_line(f"waiting for {kind} on {address}; Ctrl-C ends", stderr=True)
                if kind != "px4":
                    file = "" if parameters is None else f" --defaults {parameters}"
                    print_line(f"start it with --home={home_option(vehicle)}{file}", stderr=True)
                    print_line("without --home its vehicle is in Canberra, and nothing says so", stderr=True)
            total = None if duration_s is None else max(1, round(duration_s / vehicle.simulation.interval))
            begun = time.monotonic()
            request.orderly = True
            while not request() and (total is None or vehicle.simulation.samples < total):
                left = _CHUNK if total is None else min(_CHUNK, total - vehicle.simulation.samples)
                simulator.run(left, request)
                if total is not None:
                    progress(vehicle.simulation.samples, total)
            wall = time.monotonic() - begun
        summary = {
            "scenario": scenario.name, "estimator": vehicle.simulation.estimator.id, "state": vehicle.view.state,
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


def home_option(vehicle: Vehicle) -> str:
    """Home as ArduPilot's ``--home`` takes it: latitude, longitude (deg), height (m), heading (deg)."""
    latitude, longitude, height = vehicle.view.home
    heading = degrees(vehicle.simulation.plant.knowledge.heading) % 360.0
    return f"{degrees(latitude):.7f},{degrees(longitude):.7f},{height - vehicle.view.undulation:.2f},{heading:.1f}"


def _px4(
    stack: ExitStack, scenario: Scenario, to: str | None, speed: float | None, tlog: Path | None, rates: Sequence[str],
    **options: Any,
) -> tuple[Vehicle, Px4Lockstep, str]:  # fmt: skip
    """The vehicle as component 200 of PX4's system, in PX4's units; its log is that of a stream."""
    from insenv.logs.formats.tlog import TlogWriter
    from insenv.mavlink import Vehicle
    from insenv.mavlink.commands import answers
    from insenv.mavlink.lockstep import Px4Lockstep, px4, px4_messages, px4_rates, steering
    from insenv.mavlink.messages import parse_rates
    from insenv.mavlink.stream import Recorder
    from insenv.mavlink.vehicle import checked_speed

    pace = checked_speed(1.0 if speed is None else speed)
    chosen = px4_rates(scenario.rate_hz) | parse_rates(rates, scenario.rate_hz)
    vehicle = Vehicle(scenario, rates=chosen, speed=0.0, component=px4.COMPONENT, hil_acceleration="mm/s^2", **options)
    recorder = Recorder(vehicle, None if tlog is None else stack.enter_context(TlogWriter(tlog)))
    recorder.begin()
    simulate = px4_messages(vehicle)

    def step() -> Iterator[Any]:
        for message in simulate():
            yield message  # which sends it
            recorder.sent(message)

    simulator = Px4Lockstep(
        step, vehicle.simulation.interval, steering(vehicle, px4.CHANNELS),
        answer=lambda message: answers(vehicle, message), address=to or px4.ADDRESS, speed=pace,
    )  # fmt: skip
    return vehicle, stack.enter_context(simulator), str(simulator.link.address)


def _ardupilot(
    stack: ExitStack, scenario: Scenario, to: str | None, speed: float | None, tlog: Path | None, rates: Sequence[str],
    **options: Any,
) -> tuple[Vehicle, ArduPilotLockstep, str]:  # fmt: skip
    from insenv.mavlink import Vehicle
    from insenv.mavlink.lockstep import ArduPilotLockstep, ardupilot, moving, steering
    from insenv.mavlink.vehicle import checked_speed

    pace = checked_speed(0.0 if speed is None else speed)
    if tlog is not None or rates:
        option = "--rate" if tlog is None else "--tlog"
        raise InputError(f"{option}: ArduPilot's JSON interface has no MAVLink; allowed with --lockstep px4")
    vehicle = Vehicle(scenario, speed=0.0, **options)
    act, interval = steering(vehicle, ardupilot.CHANNELS), vehicle.simulation.interval
    simulator = ArduPilotLockstep(moving(vehicle), act, address=to or ardupilot.ADDRESS, interval=interval, speed=pace)
    return vehicle, stack.enter_context(simulator), str(simulator.address)


AUTOPILOTS: dict[str, Callable[..., tuple[Vehicle, Px4Lockstep | ArduPilotLockstep, str]]] = {
    "px4": _px4,
    "ardupilot-json": _ardupilot,
}
"""The vehicle, the simulator's side and the address that it listens on, by the interface's name."""
