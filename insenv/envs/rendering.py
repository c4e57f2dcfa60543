"""An episode as an image (attitude indicator, track, errors with their limits) or as a few lines of text."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from insenv import attitude
from insenv.envs.setup import Setup

Array = NDArray[np.float64]
History = Sequence[tuple[Array, dict[str, Any]]]
"""Observation and info of the reset and of each step of an episode."""

SIZE = (960, 480)
"""Pixels of an image, width and height."""
SKY, GROUND, TRUTH, ESTIMATE = "#8fbbe8", "#a98a63", "#1f2a44", "#d1495b"


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
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(SIZE[0] / 100.0, SIZE[1] / 100.0), dpi=100, layout="constrained")
    canvas = FigureCanvasAgg(figure)
    grid = figure.add_gridspec(2, 2, width_ratios=(1.0, 1.5))
    _indicator(figure.add_subplot(grid[0, 0]), setup, history)
    _track(figure.add_subplot(grid[1, 0]), setup, history)
    _errors(figure.add_subplot(grid[:, 1]), setup, history)
    canvas.draw()
    return np.array(canvas.buffer_rgba(), dtype=np.uint8)[..., :3].copy()


def _indicator(axes: Any, setup: Setup, history: History) -> None:
    """Draw the true and the estimated horizon and heading at the time of the latest estimate."""
    _, info = history[max(len(history) - 2, 0)]
    roll, pitch, heading = attitude.numeric.to_euler(info["q_nb"])
    axes.set_aspect("equal")
    axes.set(xlim=(-1.0, 1.0), ylim=(-1.0, 1.0), xticks=(), yticks=(), facecolor=SKY)
    along, up = np.array([np.cos(roll), -np.sin(roll)]), np.array([np.sin(roll), np.cos(roll)])
    level = -up * np.clip(pitch / np.radians(30.0), -0.9, 0.9)
    corners = [level - 3 * along, level + 3 * along, level + 3 * along - 4 * up, level - 3 * along - 4 * up]
    axes.fill(*np.array(corners).T, color=GROUND, lw=0)
    axes.plot(*np.array([level - 3 * along, level + 3 * along]).T, color="white", lw=1.5)
    if setup.task.actions.names[0] in ("estimate_q_nb", "correction") and len(history) > 1:
        shown = attitude.numeric.to_euler(_estimate(history))
        along, up = np.array([np.cos(shown[0]), -np.sin(shown[0])]), np.array([np.sin(shown[0]), np.cos(shown[0])])
        level = -up * np.clip(shown[1] / np.radians(30.0), -0.9, 0.9)
        axes.plot(*np.array([level - along, level + along]).T, color=ESTIMATE, lw=1.5, ls="--")
        caption = f"heading {np.degrees(heading) % 360.0:.2f} deg, estimate {np.degrees(shown[2]) % 360.0:.2f} deg"
    else:
        caption = f"heading {np.degrees(heading) % 360.0:.2f} deg"
    axes.plot([-0.35, -0.1, 0.0, 0.1, 0.35], [0.0, 0.0, -0.06, 0.0, 0.0], color="black", lw=2)
    axes.set_title(caption, fontsize=9)


def _estimate(history: History) -> Any:
    """Return the attitude of the latest action: the truth at its time, rotated by its error."""
    error = attitude.numeric.from_rotation_vector(np.asarray(history[-1][1]["error"])[:3])
    return attitude.numeric.multiply(error, history[-2][1]["q_nb"])


def _track(axes: Any, setup: Setup, history: History) -> None:
    """Draw the track of the vehicle, north over east, and the fixes."""
    places = np.array([info["position"] for _, info in history])
    # a swaying vehicle is sampled too rarely to join its positions by lines
    axes.plot(places[:, 1], places[:, 0], "." if setup.scenario.vehicle.in_place else "-", color=TRUTH, lw=1.2, ms=2)
    axes.plot(places[-1, 1], places[-1, 0], "o", color=TRUTH, ms=4)
    if "fix_position" in setup.layout:
        named = [setup.layout.unpack(seen) for seen, _ in history]
        fixes = np.array([seen["fix_position"] for seen in named if seen["fix_new"]]).reshape(-1, 3)
        axes.plot(fixes[:, 1], fixes[:, 0], ".", color=ESTIMATE, ms=2, zorder=0)
    axes.set_aspect("equal", adjustable="datalim")
    axes.set_xlabel("east, m", fontsize=8)
    axes.set_ylabel("north, m", fontsize=8)
    axes.tick_params(labelsize=7)


def _errors(axes: Any, setup: Setup, history: History) -> None:
    """Draw the magnitude of each error over time, with its limit."""
    step = setup.samples * setup.interval
    times = np.array([setup.time_of(seen) for seen, _ in history])
    axes.set_yscale("log")
    axes.set_xlabel("time, s", fontsize=8)
    axes.set_ylabel("magnitude of the error", fontsize=8)
    axes.tick_params(labelsize=7)
    axes.set_xlim(0.0, max(setup.decisions * step, 1e-3))
    infos = [info for _, info in history]
    if "error" not in infos[0]:
        return
    # the error in the info of a step is that of the estimate made before the step
    errors, limit = np.array([info["error"] for info in infos[1:]]), infos[-1].get("limit")
    groups = [("tilt, deg", slice(0, 2), 180.0 / np.pi), ("heading, deg", slice(2, 3), 180.0 / np.pi)]
    if len(infos[0]["error"]) > 3:
        groups += [("velocity, m/s", slice(3, 6), 1.0), ("position, m", slice(6, 9), 1.0)]
    for colour, (name, part, scale) in enumerate(groups):
        if len(errors):
            size = np.linalg.norm(errors[:, part], axis=1) * scale
            axes.plot(times[:-1], np.where(size > 0.0, size, np.nan), color=f"C{colour}", label=name)
        if limit is not None:
            axes.axhline(float(np.linalg.norm(limit[part]) * scale), color=f"C{colour}", ls=":", lw=1)
    if len(errors):
        axes.legend(fontsize=8, loc="best", title="dotted: limit", title_fontsize=8)
