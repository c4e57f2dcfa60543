"""`insenv stream`: the simulated vehicle on a MAVLink link, with a dashboard on stderr."""

from __future__ import annotations

import sys
import time
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any

from insenv.base.errors import InputError

if TYPE_CHECKING:
    from rich.console import RenderableType

    from insenv.cli.interruptions import Ending
    from insenv.evaluation.limits import Limit
    from insenv.mavlink import Stream
    from insenv.report import Report
    from insenv.scenario import Scenario

MOST_LINKS = 4
"""A telemetry log has two bits for the number of a link."""
_WIDE = 29  # columns of a message's name and rate
_UNITS = {"tilt": "deg", "heading": "deg", "velocity": "m/s", "position": "m"}
_OVER_S = 2.0
_SHOWN_CLIENTS = 4


def stream(
    scenario: str,
    estimator: str | None,
    *,
    to: Sequence[str],
    seed: int | None,
    speed: float,
    duration_s: float | None,
    tlog: Path | None,
    rates: Sequence[str],
    signing_key_file: Path | None,
    system: int,
    show_errors: bool,
    undulation: float,
    scored: bool,
    out: Path | None,
    as_json: bool,
) -> None:
    """Stream until the duration is over or an end is requested, and print a summary."""
    from insenv.cli.interruptions import ending, written
    from insenv.cli.output import print_json
    from insenv.mavlink import Stream, Vehicle
    from insenv.mavlink.messages import parse_rates
    from insenv.mavlink.score import Score, report_of
    from insenv.mavlink.wire import Signing, TlogWriter, open_link
    from insenv.report import OutputFolder, run_document, write_files
    from insenv.scenario import load

    loaded = load(scenario)
    wanted = parse_rates(list(rates), loaded.rate_hz)
    duration = checked_duration(duration_s)
    if duration is None and speed == 0.0:
        duration = loaded.duration_s
    addresses = _checked_addresses(to)
    folder = None if out is None else OutputFolder(out)
    limit = _limit(loaded, seed, duration) if scored else None
    report: Report | None = None
    with ending() as request:
        with ExitStack() as stack:
            signing = None if signing_key_file is None else Signing.from_key_file(signing_key_file)
            vehicle = Vehicle(
                loaded, estimator, seed=seed, rates=wanted, speed=speed, system=system, show_errors=show_errors,
                undulation=undulation,
            )  # fmt: skip
            vehicle.score = Score(vehicle.view, limit) if scored else None
            links = [
                stack.enter_context(open_link(address, signing=signing, system=system, number=number))
                for number, address in enumerate(addresses)
            ]
            recorder = None if tlog is None else stack.enter_context(TlogWriter(tlog))
            running = Stream(vehicle, links, recorder)
            watch = stack.enter_context(dashboard(running, request))
            request.orderly = True
            running.run(duration, watch, request)
            shown = ", ".join(str(link.address) for link in links)
            summary = running.summary() | {"address": shown, "tlog": None if tlog is None else str(tlog)}
            if vehicle.score is not None:
                report = report_of(vehicle.score)
                files = write_files(report, folder).paths if folder is not None and report.results else ()
                summary["score"] = run_document(report).as_json([str(path) for path in files])
        written(lambda: print_json(summary) if as_json else _print_summary(summary, report), request)


def _limit(scenario: Scenario, seed: int | None, duration_s: float | None) -> Limit | None:
    """The limit along the scenario, with a progress bar; None if it has none."""
    from insenv.cli.output import working
    from insenv.scenario import build, limit_of, no_limit

    plant = build(scenario, seed=seed, duration_s=duration_s)
    if no_limit(plant):
        return None
    with working(f"limit of {scenario.name}") as progress:
        return limit_of(plant, progress)


def _checked_addresses(to: Sequence[str]) -> Sequence[str]:
    """Check the addresses of the links.  Raises `InputError` for too many, or one that is named twice."""
    if len(to) > MOST_LINKS:
        raise InputError(f"--to: {len(to)} addresses; allowed are 1 to {MOST_LINKS}")
    for place, address in enumerate(to):
        if address in to[:place]:
            raise InputError(f"--to {address}: named twice; each address is one link")
    return to


def checked_duration(duration_s: float | None) -> float | None:
    """Check the duration.  Raises `InputError`."""
    if duration_s is not None and not 0.0 < duration_s < 1e9:
        raise InputError(f"--duration {duration_s:g}: allowed is above 0 and below 1e9 simulated seconds")
    return duration_s


@contextmanager
def dashboard(running: Stream, request: Ending) -> Iterator[Callable[[Stream], None] | None]:
    """A dashboard on stderr while the block runs; None if stderr is not a terminal.

    A terminal that is closed, so that nothing can be written to it, is a request to end.
    """
    if not sys.stderr.isatty():
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
        self._kept: list[tuple[float, Counter[str]]] = []

    def __call__(self, sent: Counter[str], now: float) -> dict[str, float]:
        """The rates by name at `now` (s), from the numbers of messages sent so far."""
        self._kept.append((now, Counter(sent)))
        while len(self._kept) > 2 and now - self._kept[1][0] > _OVER_S:
            del self._kept[0]
        begun, before = self._kept[0]
        elapsed = max(now - begun, 1e-3)
        return {name: (count - before[name]) / elapsed for name, count in sent.items()}


def picture(running: Stream, rates: Rates, now: float | None = None, width: int = 100) -> RenderableType:
    """The dashboard at present, in `width` columns."""
    from rich import box
    from rich.console import Group
    from rich.table import Table
    from rich.text import Text

    vehicle, simulation = running.vehicle, running.vehicle.simulation
    view, statistics, scenario = vehicle.view, running.statistics, simulation.plant.scenario
    pace = "paused" if vehicle.paused else f"speed {vehicle.speed:g}" if vehicle.speed else "as fast as possible"
    clients = [peer.name if peer.heard is None else f"{peer.name} ({peer.system}/{peer.component})" for peer in running.peers]
    more = len(clients[_SHOWN_CLIENTS:])
    shown = ", ".join(clients[:_SHOWN_CLIENTS]) + (f" and {more} more" if more else "")
    gnss = "none" if not simulation.has_gnss else "off" if not simulation.gnss_on else "fix" if view.has_lock else "no fix"
    table = Table(box=None, show_header=False, pad_edge=False, padding=(0, 2, 0, 0))
    table.add_row("vehicle", f"{scenario.name} ({scenario.vehicle.kind}), {simulation.estimator.id}")
    table.add_row("time", f"{simulation.time:.1f} s, {pace}; {simulation.time / max(running.wall_s, 1e-3):.3g} times real time")
    table.add_row("alignment", f"{view.state}{_sigmas(view.tilt_sigma_deg, view.heading_sigma_deg)}; GNSS {gnss}")
    table.add_row("error", ", ".join(f"{name} {value:.3g} {_UNITS[name]}" for name, value in view.errors.items()))
    for source in vehicle.score.sources.values() if vehicle.score is not None else ():
        table.add_row(source.name, _scored(source.latest, vehicle.score.limit_at(source.time)))  # type: ignore[union-attr]
    late = running.pacer.lateness
    table.add_row("lateness", f"p50 {late(0.5) * 1e3:.2f} ms, p99 {late(0.99) * 1e3:.2f} ms; {running.cpu_share:.0%} of a core")
    table.add_row("link", f"{', '.join(str(link.address) for link in running.links)}; clients: {shown or 'none yet'}")
    rejected = statistics.wrong_checksum + statistics.unsigned + statistics.wrongly_signed
    rejected += statistics.replayed + statistics.stale + statistics.early
    table.add_row(
        "messages",
        f"{statistics.sent_frames} sent to {len(clients)} client{'s' if len(clients) != 1 else ''},"
        f" {statistics.dropped_frames} dropped, {statistics.received_messages} received, "
        f"{rejected} rejected; {view.fields.saturated.total()} values saturated",
    )
    streamed = Table(box=box.SIMPLE_HEAD, show_edge=False, pad_edge=False, padding=(0, 2, 0, 0))
    across = max(1, min(3, (width + 2) // _WIDE))
    for _ in range(across):
        streamed.add_column("message", no_wrap=True, min_width=20)
        streamed.add_column("Hz", justify="right", min_width=5)
    cells = [
        cell
        for name, hz in sorted(rates(running.sent, time.monotonic() if now is None else now).items())
        for cell in (name[:20], f"{hz:.1f}")
    ]
    cells += [""] * (-len(cells) % (2 * across))
    for place in range(0, len(cells), 2 * across):
        streamed.add_row(*cells[place : place + 2 * across])
    return Group(table, Text(""), streamed, Text("Ctrl-C ends the stream"))


def _scored(errors: dict[str, float], limit: dict[str, float]) -> str:
    """Errors of the latest estimate of a client, each with the limit."""
    parts = []
    for name, error in errors.items():
        what, _, unit = name.rpartition("_")
        beside = f" ({limit[name]:.2g})" if name in limit else ""
        parts.append(f"{what} {error:.3g}{beside} {'m/s' if unit == 'mps' else unit}")
    return ", ".join(parts)


def _sigmas(tilt_deg: float, heading_deg: float) -> str:
    if tilt_deg != tilt_deg:
        return ""
    return f" (1 sigma: tilt {tilt_deg:.3g} deg, heading {heading_deg:.3g} deg)"


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
    if summary["tlog"]:
        print_line(f"written: {summary['tlog']}")
    if report is not None:
        print_line()
        print_blocks(run_document(report).blocks())
        if files := summary["score"].get("files"):
            print_line(f"written: {', '.join(files)}")
