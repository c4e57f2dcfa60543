"""The command `insenv stream`: the simulated vehicle on a MAVLink link, with a dashboard on stderr."""

from __future__ import annotations

import sys
import time
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal, Optional

import typer

from insenv.base.errors import InputError
from insenv.cli.lockstep import lockstep as run_lockstep
from insenv.cli.options import Json, Seed, Settings, changed_scenario, command, nonempty_path, one, out_option
from insenv.cli.options import Scenario as ScenarioName
from insenv.cli.output import is_quiet
from insenv.cli.signals import DONE, FAILED

if TYPE_CHECKING:
    from rich.console import RenderableType

    from insenv.cli.signals import Ending
    from insenv.evaluation.limits import Limit
    from insenv.mavlink import Stream
    from insenv.mavlink.vectornav import Unit
    from insenv.mavlink.wire import Address
    from insenv.report import Report
    from insenv.scenario import Scenario


MAX_LINKS = 4
"""A telemetry log has two bits for the number of a link."""


Lockstep = Literal["px4", "ardupilot-json"]
"""The autopilot interface that `insenv stream --lockstep` serves."""
UnitKind = Literal["vn300", "vn100"]
"""The inertial navigation unit that `insenv stream --as` makes of the vehicle."""
UNIT_BAUD = 921600
"""Of a serial line to a unit if the address has none."""


@command
def stream(
    scenario: ScenarioName,
    to: Annotated[
        Optional[list[str]],  # noqa: UP045
        typer.Option(
            metavar="ADDRESS",
            help="udpout:HOST:PORT, udpin:..., tcpin:..., tcpout:... or serial:DEVICE:BAUD; without HOST only this machine."
            " May be given more than once: each address is one link.",
        ),
    ] = None,
    estimator: Annotated[
        Optional[list[str]],  # noqa: UP045
        typer.Option("--estimator", "-e", metavar="ID", help="Estimator to run; the default is the scenario's first."),
    ] = None,
    seed: Seed = None,
    speed: Annotated[
        Optional[float],  # noqa: UP045
        typer.Option(
            metavar="X", help="Simulated seconds per second, 1 by default; 0: as fast as possible, the default with ArduPilot."
        ),
    ] = None,
    duration: Annotated[
        Optional[float],  # noqa: UP045
        typer.Option(metavar="S", help="Simulated seconds; by default until Ctrl-C, with --speed 0 the scenario's duration."),
    ] = None,
    tlog: Annotated[
        Optional[Path],  # noqa: UP045
        typer.Option(parser=nonempty_path, metavar="FILE", help="Write a telemetry log."),
    ] = None,
    rate: Annotated[
        Optional[list[str]],  # noqa: UP045
        typer.Option(metavar="MESSAGE=HZ", help="Rate of a message, 0 (none) to the rate of the samples; each message once."),
    ] = None,
    signing_key_file: Annotated[
        Optional[Path],  # noqa: UP045
        typer.Option(
            parser=nonempty_path,
            metavar="FILE",
            help="Sign messages with the key in this file, and accept only messages signed with it.",
        ),
    ] = None,
    system: Annotated[
        int, typer.Option(metavar="N", help="MAVLink system ID of the vehicle, 1 to 255; each vehicle needs its own.")
    ] = 1,
    errors: Annotated[bool, typer.Option("--errors", help="Send the errors of the estimate too (NAMED_VALUE_FLOAT).")] = False,
    undulation: Annotated[
        float, typer.Option(metavar="M", help="Height of the geoid above the ellipsoid, taken as constant.")
    ] = 0.0,
    unit: Annotated[
        Optional[UnitKind],  # noqa: UP045
        typer.Option(
            "--as",
            help="Send the binary outputs of this VectorNav unit to the address that is TCP or serial (docs/vectornav.md).",
        ),
    ] = None,
    lockstep: Annotated[
        Optional[Lockstep],  # noqa: UP045
        typer.Option(help="Advance sample by sample with an autopilot that connects (docs/lockstep.md)."),
    ] = None,
    write_parameters: Annotated[
        Optional[Path],  # noqa: UP045
        typer.Option(
            parser=nonempty_path,
            metavar="FILE",
            help="With --lockstep ardupilot-json: write parameters with which ArduPilot adds the least errors to the sensors.",
        ),
    ] = None,
    settings: Settings = None,
    score: Annotated[
        bool,
        typer.Option("--score", help="Judge the estimates that clients send: ODOMETRY, ATTITUDE and others (docs/score.md)."),
    ] = False,
    out: Annotated[
        Optional[Path],  # noqa: UP045
        out_option("DIR", "With --score: write the results there."),
    ] = None,
    as_json: Json = False,
) -> int:
    """Stream the simulated vehicle and its estimate live over MAVLink to ground stations and other clients."""
    from insenv.cli.output import print_json, print_line
    from insenv.cli.signals import ending, written
    from insenv.logs.formats.tlog import TlogWriter
    from insenv.mavlink import Stream, Vehicle
    from insenv.mavlink.messages import SILENT, parse_rates
    from insenv.mavlink.score import Score, report_of
    from insenv.mavlink.vectornav import UnitStream
    from insenv.mavlink.wire import Signing, open_link
    from insenv.report import OutputFolder, run_document, write_files
    from insenv.scenario import with_settings

    addresses, rates = to or [], rate or []
    _check_addresses(addresses)
    if write_parameters is not None and lockstep != "ardupilot-json":
        raise InputError("--write-parameters: allowed with --lockstep ardupilot-json")
    if lockstep is not None:
        if signing_key_file is not None:
            raise InputError("--lockstep allows no --signing-key-file: autopilots do not sign")
        options = {"--errors": errors, "--system": system != 1, "--undulation": undulation != 0.0, "--score": score}
        options["--as"] = unit is not None
        for option, is_set in options.items():
            if is_set:
                raise InputError(f"{option}: not allowed with --lockstep")
        if len(addresses) > 1:
            raise InputError(f"--to: {len(addresses)} addresses; --lockstep allows one, that of the autopilot")
    elif out is not None and not score:
        raise InputError("--out: allowed with --score, whose results it takes")
    elif not addresses:
        raise InputError("--to ADDRESS is missing, such as --to udpout:127.0.0.1:14550")
    port = None
    if unit is not None:
        port, addresses = _unit_address(addresses, unit)
        of_mavlink = {"--rate": rates, "--tlog": tlog, "--signing-key-file": signing_key_file, "--errors": errors}
        of_mavlink["--score"] = score
        unsuited = [] if addresses else [option for option, value in of_mavlink.items() if value]
        if unsuited:
            raise InputError(f"{unsuited[0]}: needs MAVLink beside --as {unit}, as by a second --to udpout:127.0.0.1:14550")
    id, (loaded, values) = one(estimator), changed_scenario(scenario, settings)
    if values:
        loaded = with_settings(loaded, values, [id] if id else loaded.estimators[:1])
    if duration is not None and not 0.0 < duration < 1e9:
        raise InputError(f"--duration {duration:g}: allowed is above 0 and below 1e9 simulated seconds")
    if lockstep is not None:
        run_lockstep(
            loaded, id, kind=lockstep, to=addresses[0] if addresses else None, seed=seed, speed=speed,
            duration_s=duration, tlog=tlog, rates=rates, parameters=write_parameters, as_json=as_json,
        )  # fmt: skip
        return DONE
    chosen = parse_rates(rates, loaded.rate_hz) if addresses else SILENT
    made = _unit_at(port, unit, loaded.rate_hz)
    pace = 1.0 if speed is None else speed
    if duration is None and pace == 0.0:
        duration = loaded.duration_s
    folder = None if out is None else OutputFolder(out)
    limit = _limit(loaded, seed, duration) if score else None
    report: Report | None = None
    with ending() as request:
        with ExitStack() as stack:
            signing = None if signing_key_file is None else Signing.from_key_file(signing_key_file)
            vehicle = Vehicle(
                loaded, id, seed=seed, rates=chosen, speed=pace, system=system, show_errors=errors, undulation=undulation
            )
            vehicle.score = Score(vehicle.view, limit) if score else None
            links = [
                stack.enter_context(open_link(address, signing=signing, system=system, number=number))
                for number, address in enumerate(addresses)
            ]
            recorder = None if tlog is None else stack.enter_context(TlogWriter(tlog))
            if made is None:
                running = Stream(vehicle, links, recorder)
            else:
                running = UnitStream(vehicle, made, stack.enter_context(open_link(str(port))), links, recorder)
            watch = stack.enter_context(dashboard(running, request))
            request.orderly = True
            running.run(duration, watch, request)
            summary = running.summary()
            summary["address"] = ", ".join(str(link.address) for link in running.all_links)
            summary["tlog"] = None if tlog is None else str(tlog)
            if vehicle.score is not None:
                report = report_of(vehicle.score)
                files = write_files(report, folder).paths if folder is not None and report.results else ()
                summary["score"] = run_document(report).as_json([str(path) for path in files])
        written(lambda: print_json(summary) if as_json else _print_summary(summary, report), request)
    unheard = [link["address"] for link in summary["links"] if link["address"].startswith("tcpout") and not link["sent_frames"]]
    if unheard:
        print_line(f"insenv: nobody accepted a connection at {', '.join(unheard)}", stderr=True)
    return FAILED if unheard and not summary["interrupted"] else DONE


def _unit_address(addresses: Sequence[str], unit: str) -> tuple[Address, list[str]]:
    """The address of the unit, and those of the MAVLink beside it, which are UDP.  Raises `InputError`."""
    from insenv.mavlink.wire import parse_address

    ports = [address for address in addresses if not address.startswith("udp")]
    if len(ports) != 1:
        raise InputError(
            f"--as {unit}: takes one --to tcpin:HOST:PORT, tcpout:HOST:PORT or serial:DEVICE:BAUD, {len(ports)} given;"
            " addresses of UDP carry MAVLink beside it"
        )
    return parse_address(ports[0], UNIT_BAUD), [address for address in addresses if address not in ports]


def _unit_at(port: Address | None, kind: UnitKind | None, sample_hz: float) -> Unit | None:
    """The unit at `port`, if one is asked for.  Raises `InputError` if its outputs do not fit into a serial line."""
    from insenv.mavlink.vectornav import MODELS, Unit

    if port is None or kind is None:
        return None
    return Unit(MODELS[kind], sample_hz, port.port if port.kind == "serial" else None)


def _limit(scenario: Scenario, seed: int | None, duration_s: float | None) -> Limit | None:
    """The limit along the scenario, with a progress bar; None if it has none."""
    from insenv.cli.output import working
    from insenv.scenario import build, limit_of, no_limit

    plant = build(scenario, seed=seed, duration_s=duration_s)
    if no_limit(plant):
        return None
    with working(f"limit of {scenario.name}") as progress:
        return limit_of(plant, progress)


def _check_addresses(to: Sequence[str]) -> None:
    """Raise `InputError` for too many links, or an address that is wrong or named twice."""
    from insenv.mavlink.wire.link import parse_address

    if len(to) > MAX_LINKS:
        raise InputError(f"--to: {len(to)} addresses; allowed are 1 to {MAX_LINKS}")
    for place, address in enumerate(to):
        parse_address(address)
        if address in to[:place]:
            raise InputError(f"--to {address}: named twice; each address is one link")


def _print_summary(summary: dict[str, Any], report: Report | None = None) -> None:
    from insenv.cli.output import print_blocks, print_line
    from insenv.report import run_document

    link, late = summary["link"], summary["lateness_ms"]
    total = sum(summary["sent"].values())
    simulated, wall, received = summary["simulated_s"], summary["wall_s"], link["received_messages"]
    who = f"{summary['scenario']}, {summary['estimator']}"
    print_line(f"{who}: {simulated:.1f} s simulated in {wall:.1f} s; {summary['state']}")
    sent = f"{total} messages to {summary['address']}, {link['dropped_frames']} dropped"
    if not link["sent_frames"]:
        sent = f"{total} messages generated, none sent: no receiver at {summary['address']}"
    print_line(f"{sent}; {received} received")
    print_line(f"lateness p50 {late['p50']:.2f} ms, p99 {late['p99']:.2f} ms; {summary['cpu_share']:.1%} of a core")
    for what, key in (("values out of range", "saturated"), ("messages not sent because of an unknown value", "refused")):
        if summary[key]:
            print_line(f"{what}: " + ", ".join(f"{name} {count}" for name, count in summary[key].items()))
    for refused, count in summary.get("commands_refused", {}).items():
        print_line(f"refused command ({count}): {refused}")
    if summary["tlog"]:
        print_line(f"written: {summary['tlog']}")
    if report is not None:
        print_line()
        print_blocks(run_document(report).blocks())
        if files := summary["score"].get("files"):
            print_line(f"written: {', '.join(files)}")


# The dashboard of `insenv stream` on stderr.

_WIDE = 29  # columns of a message's name and rate
_UNITS = {"tilt": "deg", "heading": "deg", "velocity": "m/s", "position": "m"}
_WINDOW_S = 2.0
_CLIENTS = 4  # named; more are counted
_REJECTED = ("wrong_checksum", "unsigned", "wrongly_signed", "replayed", "stale", "early")


@contextmanager
def dashboard(running: Stream, request: Ending) -> Iterator[Callable[[Stream], None] | None]:
    """A dashboard on stderr while the block runs; None with --quiet or if stderr is not a terminal.

    A terminal that is closed, so that nothing can be written to it, is a request to end.
    """
    if is_quiet() or not sys.stderr.isatty():
        yield None
        return
    from rich.console import Console
    from rich.live import Live

    console = Console(stderr=True, markup=False, highlight=False, emoji=False)
    rates = Rates()
    live = Live(picture(running, rates, width=console.width), console=console, transient=True, auto_refresh=False)

    def show(stream: Stream) -> None:
        try:
            live.update(picture(stream, rates, width=console.width), refresh=True)
        except OSError:
            request.requested = True

    live.start(refresh=True)
    try:
        yield show
    finally:
        with suppress(OSError):
            live.stop()


class Rates:
    """Message rates (Hz) over the last two seconds."""

    def __init__(self) -> None:
        self._counts: list[tuple[float, Counter[str]]] = []

    def __call__(self, sent: Counter[str], now: float) -> dict[str, float]:
        """The rates by name at `now` (s), from the numbers of messages sent so far."""
        self._counts.append((now, Counter(sent)))
        while len(self._counts) > 2 and now - self._counts[1][0] > _WINDOW_S:
            del self._counts[0]
        begun, before = self._counts[0]
        elapsed = max(now - begun, 1e-3)
        return {name: (count - before[name]) / elapsed for name, count in sent.items()}


def picture(running: Stream, rates: Rates, now: float | None = None, width: int = 100) -> RenderableType:
    """The dashboard at present, in `width` columns."""
    from rich import box
    from rich.console import Group
    from rich.table import Table
    from rich.text import Text

    table = Table(box=None, show_header=False, pad_edge=False, padding=(0, 2, 0, 0))
    for title, text in _lines(running):
        table.add_row(title, text)
    streamed = Table(box=box.SIMPLE_HEAD, show_edge=False, pad_edge=False, padding=(0, 2, 0, 0))
    across = max(1, min(3, (width + 2) // _WIDE))
    for _ in range(across):
        streamed.add_column("message", no_wrap=True, min_width=20)
        streamed.add_column("Hz", justify="right", min_width=5)
    by_name = sorted(rates(running.sent, time.monotonic() if now is None else now).items())
    cells = [cell for name, hz in by_name for cell in (name[:20], f"{hz:.1f}")]
    for place in range(0, len(cells), 2 * across):
        streamed.add_row(*cells[place : place + 2 * across])
    return Group(table, Text(""), streamed, Text("Ctrl-C ends the stream"))


def _lines(running: Stream) -> Iterator[tuple[str, str]]:
    """What the dashboard says beside the rates: title and text."""
    vehicle, simulation, late = running.vehicle, running.vehicle.simulation, running.pacer.lateness
    view, statistics, scenario, score = vehicle.view, running.statistics, simulation.plant.scenario, vehicle.score
    pace = "paused" if vehicle.paused else f"speed {vehicle.speed:g}" if vehicle.speed else "as fast as possible"
    clients = [peer.name if peer.heard is None else f"{peer.name} ({peer.system}/{peer.component})" for peer in running.peers]
    more = f" and {len(clients) - _CLIENTS} more" if len(clients) > _CLIENTS else ""
    gnss = "none" if not simulation.has_gnss else "off" if not simulation.gnss_on else "fix" if view.has_lock else "no fix"
    tilt, heading = view.tilt_sigma_deg, view.heading_sigma_deg
    sigmas = f" (1 sigma: tilt {tilt:.3g} deg, heading {heading:.3g} deg)" if tilt == tilt else ""
    yield "vehicle", f"{scenario.name} ({scenario.vehicle.kind}), {simulation.estimator.id}"
    yield "time", f"{simulation.time:.1f} s, {pace}; {simulation.time / max(running.wall_s, 1e-3):.3g} times real time"
    yield "alignment", f"{view.state}{sigmas}; GNSS {gnss}"
    yield "error", ", ".join(f"{name} {value:.3g} {_UNITS[name]}" for name, value in view.errors.items())
    if score is not None:
        for source in score.sources.values():
            yield source.name, _scored(source.latest, score.limit_at(source.time))
    yield "lateness", f"p50 {late(0.5) * 1e3:.2f} ms, p99 {late(0.99) * 1e3:.2f} ms; {running.cpu_share:.0%} of a core"
    addresses = ", ".join(str(link.address) for link in running.all_links)
    yield "link", f"{addresses}; clients: {', '.join(clients[:_CLIENTS]) + more or 'none yet'}"
    yield (
        "messages",
        (
            f"{statistics.sent_frames} sent to {len(clients)} client{'s' if len(clients) != 1 else ''},"
            f" {statistics.dropped_frames} dropped, {statistics.received_messages} received, "
            f"{sum(getattr(statistics, name) for name in _REJECTED)} rejected; {view.fields.saturated.total()} values saturated"
        ),
    )


def _scored(errors: dict[str, float], limit: dict[str, float]) -> str:
    """Errors of the latest estimate of a client, each with the limit."""
    parts = []
    for name, error in errors.items():
        quantity, _, unit = name.rpartition("_")
        beside = f" ({limit[name]:.2g})" if name in limit else ""
        parts.append(f"{quantity} {error:.3g}{beside} {'m/s' if unit == 'mps' else unit}")
    return ", ".join(parts)
