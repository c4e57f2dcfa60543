"""Navigate a recorded car log: the 15-state filter on a Honeywell HGuide n380, beside figures of KF-GINS for the same log.

    pip install onavdata==0.2.5
    python examples/navigate_a_log.py

KF-GINS used the positions of GNSS alone: so does the first column.  The second uses its velocities too.  The reference
is the unit's own solution from the same GNSS, so a difference is a disagreement, not an error.
"""

from pathlib import Path

from insenv.replay import replay

FOLDER = Path(__file__).resolve().parent

reports = [
    replay(FOLDER / name, ["loosely-coupled"], start="reference") for name in ("n380-car-position-only.toml", "n380-car.toml")
]
positions, both = (report.results[0].statistics()["rms"] for report in reports)
published, theirs = reports[0].published[0]

print(reports[0].title)
print(f"RMS from {reports[0].results[0].from_s:g} s on; published: {published}")
print(f"{'':12}{'positions':>12}{'+ velocities':>14}{'published':>12}")
for name in theirs:
    print(f"{name:12}{positions[name]:12.4f}{both[name]:14.4f}{theirs[name]:12.4f}")
