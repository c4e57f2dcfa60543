"""Active alignment: four ways to drive a car whose heading is unknown.

    python examples/active_alignment.py [--out DIR]

GNSS measures the direction of travel, not the orientation of the inertial unit.  Straight motion at constant speed does not
relate the two.  Every change of speed or direction is measured by both the unit and GNSS, and relates them.
"""

import argparse
from pathlib import Path

import gymnasium
import numpy as np

import insenv

SECONDS, SEEDS = 60, range(12)
PATTERNS = {  # (acceleration, turn) at second k, in 3 m/s^2
    "straight, constant speed": lambda k: (0.0, 0.0),
    "accelerate and brake": lambda k: (1.0, 0.0) if k % 8 < 4 else (-1.0, 0.0),
    "circle": lambda k: (0.0, 1.0),
    "S-turns": lambda k: (0.0, 1.0) if k % 16 < 8 else (0.0, -1.0),
}
SHOWN = (5, 10, 20, 40, 60)


def drive(env, pattern, seed):
    """Return the stated sigma and the true error of the heading, (SECONDS, 2, deg), and the track (SECONDS, 3, m, n)."""
    env.reset(seed=seed)
    heading, track = [], []
    for k in range(SECONDS):
        _, _, terminated, _, info = env.step(np.array(pattern(k)))
        heading.append((info["heading_sigma"], info["heading_error"]))
        track.append(info["position"])
        assert not terminated
    return np.degrees(heading), np.array(track)


def draw(path, found):
    from insenv.base import style

    time = np.arange(1, SECONDS + 1)
    path.mkdir(parents=True, exist_ok=True)
    with style.page(9.0, 4.8) as figure:
        left, right = figure.subplots(1, 2, width_ratios=(1.4, 1))
        for colour, (name, (heading, tracks)) in zip(style.COLOURS, found.items(), strict=False):
            left.plot(time, np.median(heading[..., 0], axis=0), color=colour, label=name)
            left.plot(time, np.sqrt(np.mean(heading[..., 1] ** 2, axis=0)), color=colour, linestyle=":")
            right.plot(tracks[0][:, 1] - tracks[0][0, 1], tracks[0][:, 0] - tracks[0][0, 0], color=colour)
        left.plot([], [], color=style.PALE, label="stated sigma, median of the seeds")
        left.plot([], [], color=style.PALE, linestyle=":", label="true error, rms of the seeds")
        left.set(xlabel="time [s]", title="Heading [deg]", yscale="log", xlim=(0, SECONDS))
        style.log(left)
        right.set(xlabel="east [m]", ylabel="north [m]", title="Track of the first seed")
        right.set_aspect("equal", adjustable="datalim")
        style.legend(figure, left, columns=3)
        style.save(figure, {"png": path / "active-alignment.png"})
    print(f"figure: {path / 'active-alignment.png'}")


def main():
    parser = argparse.ArgumentParser(description="Ways to drive that make the heading of a car observable")
    parser.add_argument("--out", type=Path, help="folder for a figure")
    given = parser.parse_args()
    # the unit and the speed of the scenario, and a goal out of reach: every drive lasts its full time
    fixed = {"imu": None, "start_speed_mps": (12.0, 12.0), "goal_deg": 1e-3}
    env = gymnasium.make("insenv/Manoeuvre-v0", samples_per_step=200, **fixed)
    found = {}
    for name, pattern in PATTERNS.items():
        runs = [drive(env, pattern, seed) for seed in SEEDS]
        found[name] = np.array([heading for heading, _ in runs]), [track for _, track in runs]

    print(f"insenv {insenv.__version__}: heading [deg], stated sigma (median) / true error (rms) of {len(SEEDS)} seeds")
    print("after" + " " * 19 + "".join(f"{second:>13} s" for second in SHOWN))
    for name, (heading, _) in found.items():
        sigma, error = np.median(heading[..., 0], axis=0), np.sqrt(np.mean(heading[..., 1] ** 2, axis=0))
        print(f"{name:24s}" + "".join(f"{f'{sigma[s - 1]:.2f} / {error[s - 1]:.2f}':>15}" for s in SHOWN))
    if given.out:
        draw(given.out, found)


if __name__ == "__main__":
    main()
