"""The dashboard of `insenv stream` on stderr."""

from __future__ import annotations

import sys
import time
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from typing import TYPE_CHECKING

from insenv.cli.output import is_quiet

if TYPE_CHECKING:
    from rich.console import RenderableType

    from insenv.cli.signals import Ending
    from insenv.mavlink import Stream

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
