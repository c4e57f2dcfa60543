"""An episode as an image (attitude indicator, track, errors with their limits) or as a few lines of text."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from insenv import attitude
from insenv.base import style
from insenv.core.tables import Array
from insenv.envs.setup import Setup


class Seen(NamedTuple):
    """What a reset or a step returned, and its time (s)."""

    time: float
    observation: Array
    info: dict[str, Any]


History = Sequence[Seen]
"""Of the reset and of each step of an episode."""

SIZE = (960, 480)
"""Pixels of an image, width and height."""
SKY, GROUND, TRUTH, ESTIMATE = "#8fbbe8", "#a98a63", "#1f2a44", style.COLOURS[1]
LEAST_TRACK = 1.0
"""Extent of a track that is drawn in full size, m."""
TEXT, SMALL = 11.0, 10.0
"""Sizes of the text at 100 pixels per inch: 15 and 14 pixels."""


def write(setup: Setup, history: History) -> str:
    """Return the present time, true attitude, error and limit as text for a terminal."""
    info = history[-1].info
    lines = [f"time     {history[-1].time:9.2f} s"]
    roll, pitch, heading = np.degrees(attitude.numeric.to_euler(info["q_nb"]))
    lines.append(f"truth    roll {roll:8.3f} deg  pitch {pitch:8.3f} deg  heading {heading % 360.0:8.3f} deg")
    for name in ("error", "limit"):
        if name in info:
            lines += _components(name, np.asarray(info[name]))
    return "\n".join(lines) + "\n"


def _components(what: str, values: Array) -> list[str]:
    north, east, down = np.degrees(values[:3])
    lines = [f"{what:8} about north {north:.4f}  east {east:.4f}  down {down:.4f} deg"]
    if len(values) > 3:
        parts = (("velocity", "m/s", values[3:6]), ("position", "m", values[6:9]))
        lines += [f"{'':8} {name} " + "  ".join(f"{v:.3f}" for v in vector) + f" {unit}" for name, unit, vector in parts]
    return lines


class Drawing:
    """The image of an episode: a figure that is drawn once for each set of bounds of its axes, and the curves on it.

    Nearly all the time that matplotlib takes is that of the axes, ticks and texts.  Bounds move in steps of 1, 2, 5, 10, ...
    and depend on nothing but the episode, so that an image does not depend on what was drawn before.
    """

    def __init__(self, setup: Setup, first: dict[str, Any]) -> None:
        """first: info of a reset."""
        with _styled(), style.page(SIZE[0] / 100.0, SIZE[1] / 100.0) as figure:
            self._figure: Any = figure
            figure.set_layout_engine("none")
            grid = figure.add_gridspec(
                2, 3, width_ratios=(1.2, 1.0, 1.0), height_ratios=(1.0, 1.1), left=0.085, right=0.985, bottom=0.185,
                top=0.925, wspace=0.3, hspace=0.34,
            )  # fmt: skip
            self._panels = [
                _Indicator(figure.add_subplot(grid[0, 0]), setup),
                _Track(figure.add_subplot(grid[1, 0]), setup),
                *_error_panels(figure, grid, setup, first),
            ]
            style.legend(figure, [panel.axes for panel in self._panels])
        self._bounds: list[Any] = []
        self._background: Any = None

    def image(self, history: History) -> NDArray[np.uint8]:
        """The episode so far (height, width, 3)."""
        canvas = self._figure.canvas
        bounds = [panel.show(history) for panel in self._panels]
        if bounds != self._bounds:
            with _styled():
                for panel, one in zip(self._panels, bounds, strict=True):
                    panel.bound(one)
                canvas.draw()  # all but the animated parts
            self._background, self._bounds = canvas.copy_from_bbox(self._figure.bbox), bounds
        canvas.restore_region(self._background)
        for panel in self._panels:
            for part in panel.parts:
                panel.axes.draw_artist(part)
        return np.array(canvas.buffer_rgba(), dtype=np.uint8)[..., :3].copy()


@contextmanager
def _styled() -> Iterator[None]:
    import matplotlib as mpl

    with style.styled(), mpl.rc_context(_SIZES):
        yield


_SIZES: Any = {
    "font.size": TEXT,
    "axes.titlesize": TEXT,
    "axes.labelsize": SMALL,
    "xtick.labelsize": SMALL,
    "ytick.labelsize": SMALL,
    "legend.fontsize": SMALL,
    "lines.linewidth": 1.6,
}


class _Panel(ABC):
    """Axes and the parts on them that change with each image, in the order in which they are drawn."""

    def __init__(self, axes: Any, setup: Setup) -> None:
        self.axes, self.setup, self.parts = axes, setup, list[Any]()

    def line(self, *form: str, **more: Any) -> Any:
        """A line without points; form, more: as for `plot`."""
        (line,) = self.axes.plot([], [], *form, animated=True, **more)
        self.parts.append(line)
        return line

    @abstractmethod
    def show(self, history: History) -> tuple[float, ...]:
        """Set the parts; return the bounds of the axes, as `bound` takes them."""

    def bound(self, bounds: tuple[float, ...]) -> None:
        """Set the bounds of the axes: left, right, lower, upper."""
        self.axes.set(xlim=bounds[:2], ylim=bounds[2:])


class _Indicator(_Panel):
    """The true and the estimated horizon and heading at the time of the latest estimate."""

    def __init__(self, axes: Any, setup: Setup) -> None:
        super().__init__(axes, setup)
        axes.set(xticks=(), yticks=(), facecolor=SKY)
        axes.set_aspect("equal")
        (self._ground,) = axes.fill([0.0] * 4, [0.0] * 4, color=GROUND, lw=0, animated=True)
        self.parts.append(self._ground)
        self._horizon = self.line(color="white", lw=2.0)
        self._estimate = self.line(color=ESTIMATE, lw=2.5, ls="--")
        self.line(color="black", lw=2).set_data([-0.35, -0.1, 0.0, 0.1, 0.35], [0.0, 0.0, -0.06, 0.0, 0.0])
        self._caption = axes.text(0.5, 1.06, "", transform=axes.transAxes, ha="center", animated=True)
        self.parts.append(self._caption)
        self._shows_estimate = setup.task.actions.names[0] in ("estimate_q_nb", "correction")

    def show(self, history: History) -> tuple[float, ...]:
        info = history[max(len(history) - 2, 0)].info
        along, up, level, heading = _horizon(info["q_nb"])
        self._ground.set_xy([level - 3 * along, level + 3 * along, level + 3 * along - 4 * up, level - 3 * along - 4 * up])
        self._horizon.set_data(*np.array([level - 3 * along, level + 3 * along]).T)
        caption, ends = f"heading {heading:.2f}°", np.zeros((0, 2))
        if self._shows_estimate and len(history) > 1:
            along, _, level, heading = _horizon(_estimate(history))
            caption, ends = f"{caption}, estimate {heading:.2f}°", np.array([level - along, level + along])
        self._estimate.set_data(*ends.T)
        self._caption.set_text(caption)
        return -1.0, 1.0, -1.0, 1.0


def _horizon(q_nb: Array) -> tuple[Array, Array, Array, float]:
    """Return the directions along and up from the horizon of an attitude in the image, its middle, and the heading, deg."""
    roll, pitch, heading = attitude.numeric.to_euler(q_nb)
    along, up = np.array([np.cos(roll), -np.sin(roll)]), np.array([np.sin(roll), np.cos(roll)])
    return along, up, -up * np.clip(pitch / np.radians(30.0), -0.9, 0.9), np.degrees(heading) % 360.0


def _estimate(history: History) -> Any:
    """Return the attitude of the latest action: the truth at its time, rotated by its error."""
    error = attitude.numeric.from_rotation_vector(np.asarray(history[-1].info["error"])[:3])
    return attitude.numeric.multiply(error, history[-2].info["q_nb"])


class _Track(_Panel):
    """The track of the vehicle, north over east, and the fixes."""

    def __init__(self, axes: Any, setup: Setup) -> None:
        super().__init__(axes, setup)
        axes.locator_params(nbins=5)
        axes.set(xlabel="east [m]", ylabel="north [m]")
        self._fixes = self.line(".", color=ESTIMATE, ms=3)
        # a swaying vehicle is sampled too rarely to join its positions by lines
        self._way = self.line("." if setup.scenario.vehicle.in_place else "-", color=TRUTH, ms=4)
        self._present = self.line("o", color=TRUTH, ms=7)

    def show(self, history: History) -> tuple[float, ...]:
        places = np.array([info["position"][:2] for *_, info in history])
        if "fix_position" in self.setup.layout:
            named = [self.setup.layout.unpack(seen.observation) for seen in history]
            fixes = np.array([seen["fix_position"] for seen in named if seen["fix_new"]]).reshape(-1, 3)
            self._fixes.set_data(fixes[:, 1], fixes[:, 0])
            shown = np.concatenate([places, fixes[:, :2]])
        else:
            shown = places
        self._way.set_data(places[:, 1], places[:, 0])
        self._present.set_data(places[-1:, 1], places[-1:, 0])
        low, high = shown.min(axis=0), shown.max(axis=0)
        size = _step_above(max(float(np.max(high - low)), LEAST_TRACK))
        north, east = 0.25 * size * np.round((low + high) / (0.5 * size))
        box = self.axes.bbox
        up = 0.7 * size * max(1.0, box.height / box.width)
        right = up * box.width / box.height  # a metre is as long in both directions
        return float(east - right), float(east + right), float(north - up), float(north + up)


class _Error(_Panel):
    """The magnitude of a part of the error over time, with its limit.  A scale of decades."""

    def __init__(self, axes: Any, setup: Setup, part: slice, scale: float, first: dict[str, Any]) -> None:
        super().__init__(axes, setup)
        self._part, self._scale = part, scale
        self._error = self.line(color=style.COLOURS[0], **({"label": "error"} if "error" in first else {}))
        self._limit = self.line(
            color=style.LIMIT, ls=style.DASHED, lw=1.4, **({"label": "theoretical limit"} if "limit" in first else {})
        )

    def show(self, history: History) -> tuple[float, ...]:
        times = np.array([seen.time for seen in history])
        # the error in the info of a step is that of the estimate made before the step
        errors = np.array([info["error"][self._part] for *_, info in history[1:] if "error" in info])
        size = np.linalg.norm(errors, axis=1) * self._scale if len(errors) else np.zeros(0)
        self._error.set_data(times[: len(size)], np.where(size > 0.0, size, np.nan))
        end = _axis_end(float(times[-1]), self.setup.decisions * self.setup.samples * self.setup.interval)
        limit = history[-1].info.get("limit")
        limits = [] if limit is None else [float(np.linalg.norm(limit[self._part]) * self._scale)]
        self._limit.set_data([0.0, end] if limits else [], limits * 2)
        return 0.0, end, *_decades([*size, *limits])

    def bound(self, bounds: tuple[float, ...]) -> None:
        super().bound(bounds)
        style.log(self.axes)


def _error_panels(figure: Any, grid: Any, setup: Setup, first: dict[str, Any]) -> list[_Error]:
    """The panels of tilt, heading and, if they are known, velocity and position."""
    groups = [("tilt", "deg", slice(0, 2)), ("heading", "deg", slice(2, 3))]
    places: list[Any] = [grid[0, 1:], grid[1, 1:]]
    if len(first.get("error", ())) > 3:
        groups += [("velocity", "m/s", slice(3, 6)), ("position", "m", slice(6, 9))]
        places = [grid[0, 1], grid[1, 1], grid[0, 2], grid[1, 2]]
    panels = []
    for place, (name, unit, part) in zip(places, groups, strict=True):
        axes = figure.add_subplot(place)
        axes.set_title(f"{name} error [{unit}]")
        axes.locator_params(axis="x", nbins=4 if len(places) > 2 else 7)
        panels.append(_Error(axes, setup, part, 180.0 / np.pi if unit == "deg" else 1.0, first))
    for above, below in zip(panels[::2], panels[1::2], strict=True):
        above.axes.tick_params(labelbottom=False)
        below.axes.set_xlabel("time [s]")
    return panels


def _decades(values: Iterable[float]) -> tuple[float, float]:
    """Powers of ten around the positive values."""
    powers = np.log10([value for value in values if 0.0 < value < np.inf] or [1.0])
    low = float(np.floor(powers.min()))
    return 10.0**low, 10.0 ** max(float(np.ceil(powers.max())), low + 1.0)


def _step_above(value: float) -> float:
    """The smallest of 1, 2, 5, 10, ... times a power of ten that is not below `value`, which is positive."""
    power = 10.0 ** np.floor(np.log10(value))
    return float(next(step * power for step in (1.0, 2.0, 5.0, 10.0) if value <= step * power))


def _axis_end(now: float, episode: float) -> float:
    """End of the time axis, s: 1, 2 or 5 times a power of ten after `now`, at most that of the episode."""
    return min(_step_above(max(now, 1e-3)), max(episode, 1e-3))
