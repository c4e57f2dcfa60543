"""Pictures of an episode: attitude indicator, track and error against its limit; or a few lines of text."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from insenv import attitude

if TYPE_CHECKING:
    from insenv.envs.single import InertialEnv

Array = NDArray[np.float64]

SIZE = (960, 480)
"""Pixels of an image, width and height."""
SKY, GROUND, TRUTH, ESTIMATE = "#8fbbe8", "#a98a63", "#1f2a44", "#d1495b"


def written(env: InertialEnv) -> str:
    """Time, true attitude, error and limit of the episode so far, for a terminal."""
    observation, info = _latest(env)
    names = env.named(observation)
    lines = []
    if "time" in names:
        lines.append(f"time     {float(names['time']):9.2f} s")
    roll, pitch, heading = np.degrees(attitude.numeric.to_euler(info["q_nb"]))
    lines.append(f"truth    roll {roll:8.3f} deg  pitch {pitch:8.3f} deg  heading {heading % 360.0:8.3f} deg")
    for name, what in (("error", "error"), ("limit", "limit")):
        if name in info:
            lines += _components(what, np.asarray(info[name]))
    return "\n".join(lines) + "\n"


def _components(what: str, values: Array) -> list[str]:
    north, east, down = np.degrees(values[:3])
    lines = [f"{what:8} about north {north:.4f}  east {east:.4f}  down {down:.4f} deg"]
    if len(values) > 3:
        parts = (("velocity", "m/s", values[3:6]), ("position", "m", values[6:9]))
        lines += [f"{'':8} {name} " + "  ".join(f"{v:.3f}" for v in vector) + f" {unit}" for name, unit, vector in parts]
    return lines


def drawn(env: InertialEnv) -> NDArray[np.uint8]:
    """The episode so far as an image (height, width, 3)."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(SIZE[0] / 100.0, SIZE[1] / 100.0), dpi=100, layout="constrained")
    canvas = FigureCanvasAgg(figure)
    grid = figure.add_gridspec(2, 2, width_ratios=(1.0, 1.5))
    _indicator(figure.add_subplot(grid[0, 0]), env)
    _track(figure.add_subplot(grid[1, 0]), env)
    _errors(figure.add_subplot(grid[:, 1]), env)
    canvas.draw()
    return np.array(canvas.buffer_rgba(), dtype=np.uint8)[..., :3].copy()


def _latest(env: InertialEnv) -> tuple[Any, dict[str, Any]]:
    if not env.history:
        raise ValueError("nothing to draw before reset()")
    return env.history[-1]


def _times(env: InertialEnv) -> Any:
    """Time of each observation of the history, s."""
    return np.arange(len(env.history or ())) * env.setup.samples * env.setup.interval


def _indicator(axes: Any, env: InertialEnv) -> None:
    """Horizon and heading of the truth, and of the latest estimate, at the time that it was made for."""
    assert env.history is not None
    _, info = env.history[max(len(env.history) - 2, 0)]
    roll, pitch, heading = attitude.numeric.to_euler(info["q_nb"])
    axes.set_aspect("equal")
    axes.set(xlim=(-1.0, 1.0), ylim=(-1.0, 1.0), xticks=(), yticks=(), facecolor=SKY)
    along, up = np.array([np.cos(roll), -np.sin(roll)]), np.array([np.sin(roll), np.cos(roll)])
    level = -up * np.clip(pitch / np.radians(30.0), -0.9, 0.9)
    corners = [level - 3 * along, level + 3 * along, level + 3 * along - 4 * up, level - 3 * along - 4 * up]
    axes.fill(*np.array(corners).T, color=GROUND, lw=0)
    axes.plot(*np.array([level - 3 * along, level + 3 * along]).T, color="white", lw=1.5)
    if "error" in info and env.setup.task.actions.names[0] == "estimate_q_nb" and len(env.history or ()) > 1:
        shown = attitude.numeric.to_euler(_estimate(env))
        along, up = np.array([np.cos(shown[0]), -np.sin(shown[0])]), np.array([np.sin(shown[0]), np.cos(shown[0])])
        level = -up * np.clip(shown[1] / np.radians(30.0), -0.9, 0.9)
        axes.plot(*np.array([level - along, level + along]).T, color=ESTIMATE, lw=1.5, ls="--")
        caption = f"heading {np.degrees(heading) % 360.0:.2f} deg, estimate {np.degrees(shown[2]) % 360.0:.2f} deg"
    else:
        caption = f"heading {np.degrees(heading) % 360.0:.2f} deg"
    axes.plot([-0.35, -0.1, 0.0, 0.1, 0.35], [0.0, 0.0, -0.06, 0.0, 0.0], color="black", lw=2)
    axes.set_title(caption, fontsize=9)


def _estimate(env: InertialEnv) -> Any:
    """The attitude of the latest action: the truth that it was judged by, turned by its error."""
    assert env.history is not None
    error = attitude.numeric.from_rotation_vector(np.asarray(env.history[-1][1]["error"])[:3])
    return attitude.numeric.multiply(error, env.history[-2][1]["q_nb"])


def _track(axes: Any, env: InertialEnv) -> None:
    """Where the vehicle has been, north over east, and the latest fixes."""
    assert env.history is not None
    places = np.array([info.get("position", np.zeros(3)) for _, info in env.history])
    # what sways is seen at too few times to be joined by lines
    axes.plot(places[:, 1], places[:, 0], "." if env.setup.scenario.vehicle.in_place else "-", color=TRUTH, lw=1.2, ms=2)
    axes.plot(places[-1, 1], places[-1, 0], "o", color=TRUTH, ms=4)
    if "fix_position" in env.layout:
        named = [env.named(seen) for seen, _ in env.history]
        fixes = np.array([seen["fix_position"] for seen in named if seen["fix_new"]]).reshape(-1, 3)
        axes.plot(fixes[:, 1], fixes[:, 0], ".", color=ESTIMATE, ms=2, zorder=0)
    axes.set_aspect("equal", adjustable="datalim")
    axes.set_xlabel("east, m", fontsize=8)
    axes.set_ylabel("north, m", fontsize=8)
    axes.tick_params(labelsize=7)


def _errors(axes: Any, env: InertialEnv) -> None:
    """Magnitude of the errors over time, each with its limit."""
    assert env.history is not None
    times = _times(env)
    axes.set_yscale("log")
    axes.set_xlabel("time, s", fontsize=8)
    axes.set_ylabel("magnitude of the error", fontsize=8)
    axes.tick_params(labelsize=7)
    axes.set_xlim(0.0, max(env.setup.rounds * env.setup.samples * env.setup.interval, 1e-3))
    infos = [info for _, info in env.history]
    if "error" not in infos[0]:
        return
    # the error in the info after a step is that of the estimate at the time before
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
