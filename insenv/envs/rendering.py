"""An episode as an image (attitude indicator, track, errors with their limits) or as a few lines of text."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from insenv import attitude
from insenv.base import style
from insenv.core.tables import Array
from insenv.envs.setup import Setup

History = Sequence[tuple[Array, dict[str, Any]]]
"""Observation and info of the reset and of each step of an episode."""

SIZE = (960, 480)
"""Pixels of an image, width and height."""
SKY, GROUND, TRUTH, ESTIMATE = "#8fbbe8", "#a98a63", "#1f2a44", style.COLOURS[1]
TEXT, SMALL = 11.0, 10.0
"""Sizes of the text at 100 pixels per inch: 15 and 14 pixels."""


def write(setup: Setup, history: History) -> str:
    """Return the present time, true attitude, error and limit as text for a terminal."""
    observation, info = history[-1]
    lines = [f"time     {setup.time_of(observation):9.2f} s"]
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


def draw(setup: Setup, history: History) -> NDArray[np.uint8]:
    """Return the episode so far as an image (height, width, 3)."""
    import matplotlib as mpl

    with style.page(SIZE[0] / 100.0, SIZE[1] / 100.0) as figure, mpl.rc_context(_SIZES):
        grid = figure.add_gridspec(2, 3, width_ratios=(1.2, 1.0, 1.0), height_ratios=(1.0, 1.1))
        _indicator(figure.add_subplot(grid[0, 0]), setup, history)
        _track(figure.add_subplot(grid[1, 0]), setup, history)
        _errors(figure, grid, setup, history)
        canvas: Any = figure.canvas
        canvas.draw()
        return np.array(canvas.buffer_rgba(), dtype=np.uint8)[..., :3].copy()


_SIZES: Any = {
    "font.size": TEXT,
    "axes.titlesize": TEXT,
    "axes.labelsize": SMALL,
    "xtick.labelsize": SMALL,
    "ytick.labelsize": SMALL,
    "legend.fontsize": SMALL,
    "lines.linewidth": 1.6,
}


def _indicator(axes: Any, setup: Setup, history: History) -> None:
    """Draw the true and the estimated horizon and heading at the time of the latest estimate."""
    _, info = history[max(len(history) - 2, 0)]
    axes.set_aspect("equal")
    axes.set(xlim=(-1.0, 1.0), ylim=(-1.0, 1.0), xticks=(), yticks=(), facecolor=SKY)
    along, up, level, heading = _horizon(info["q_nb"])
    corners = [level - 3 * along, level + 3 * along, level + 3 * along - 4 * up, level - 3 * along - 4 * up]
    axes.fill(*np.array(corners).T, color=GROUND, lw=0)
    axes.plot(*np.array([level - 3 * along, level + 3 * along]).T, color="white", lw=2.0)
    caption = f"heading {heading:.2f}°"
    if setup.task.actions.names[0] in ("estimate_q_nb", "correction") and len(history) > 1:
        along, _, level, heading = _horizon(_estimate(history))
        axes.plot(*np.array([level - along, level + along]).T, color=ESTIMATE, lw=2.5, ls="--")
        caption += f", estimate {heading:.2f}°"
    axes.plot([-0.35, -0.1, 0.0, 0.1, 0.35], [0.0, 0.0, -0.06, 0.0, 0.0], color="black", lw=2)
    axes.grid(visible=False)
    axes.set_title(caption, loc="center")


def _horizon(q_nb: Array) -> tuple[Array, Array, Array, float]:
    """Return the directions along and up from the horizon of an attitude in the image, its middle, and the heading, deg."""
    roll, pitch, heading = attitude.numeric.to_euler(q_nb)
    along, up = np.array([np.cos(roll), -np.sin(roll)]), np.array([np.sin(roll), np.cos(roll)])
    return along, up, -up * np.clip(pitch / np.radians(30.0), -0.9, 0.9), np.degrees(heading) % 360.0


def _estimate(history: History) -> Any:
    """Return the attitude of the latest action: the truth at its time, rotated by its error."""
    error = attitude.numeric.from_rotation_vector(np.asarray(history[-1][1]["error"])[:3])
    return attitude.numeric.multiply(error, history[-2][1]["q_nb"])


def _track(axes: Any, setup: Setup, history: History) -> None:
    """Draw the track of the vehicle, north over east, and the fixes."""
    places = np.array([info["position"] for _, info in history])
    # a swaying vehicle is sampled too rarely to join its positions by lines
    in_place = setup.scenario.vehicle.in_place
    axes.plot(places[:, 1], places[:, 0], "." if in_place else "-", color=TRUTH, ms=4)
    axes.plot(places[-1, 1], places[-1, 0], "o", color=TRUTH, ms=7)
    if "fix_position" in setup.layout:
        named = [setup.layout.unpack(seen) for seen, _ in history]
        fixes = np.array([seen["fix_position"] for seen in named if seen["fix_new"]]).reshape(-1, 3)
        axes.plot(fixes[:, 1], fixes[:, 0], ".", color=ESTIMATE, ms=3, zorder=0)
    axes.set_aspect("equal", adjustable="datalim")
    axes.locator_params(nbins=5)
    axes.set(xlabel="east [m]", ylabel="north [m]")


def _errors(figure: Any, grid: Any, setup: Setup, history: History) -> None:
    """Draw the magnitude of each error over time with its limit: tilt, heading and, if known, velocity and position."""
    times = np.array([setup.time_of(seen) for seen, _ in history])
    infos = [info for _, info in history]
    groups = [("tilt", "deg", slice(0, 2)), ("heading", "deg", slice(2, 3))]
    places: list[Any] = [grid[0, 1:], grid[1, 1:]]
    if len(infos[0].get("error", ())) > 3:
        groups += [("velocity", "m/s", slice(3, 6)), ("position", "m", slice(6, 9))]
        places = [grid[0, 1], grid[1, 1], grid[0, 2], grid[1, 2]]
    # the error in the info of a step is that of the estimate made before the step
    errors, limit = [info["error"] for info in infos[1:] if "error" in info], infos[-1].get("limit")
    panels = [figure.add_subplot(place) for place in places]
    end = _axis_end(float(times[-1]), setup.decisions * setup.samples * setup.interval)
    for axes, (name, unit, part) in zip(panels, groups, strict=True):
        scale = 180.0 / np.pi if unit == "deg" else 1.0
        if errors:
            size = np.linalg.norm(np.array(errors)[:, part], axis=1) * scale
            axes.plot(times[:-1], np.where(size > 0.0, size, np.nan), color=style.COLOURS[0], label="error")
        if limit is not None:
            bound = float(np.linalg.norm(limit[part]) * scale)
            axes.axhline(bound, color=style.LIMIT, ls=style.DASHED, lw=1.4, label="theoretical limit")
        axes.set(title=f"{name} error [{unit}]", xlim=(0.0, end))
        style.log(axes)
        axes.locator_params(axis="x", nbins=4 if len(panels) > 2 else 7)
    for above, below in zip(panels[::2], panels[1::2], strict=True):
        above.tick_params(labelbottom=False)
        below.set_xlabel("time [s]")
    style.legend(figure, panels)


def _axis_end(now: float, episode: float) -> float:
    """End of the time axis, s: 1, 2 or 5 times a power of ten after `now`, at most that of the episode."""
    power = 10.0 ** np.floor(np.log10(max(now, 1e-3)))
    return float(min(next(step * power for step in (1.0, 2.0, 5.0, 10.0) if now <= step * power), max(episode, 1e-3)))
