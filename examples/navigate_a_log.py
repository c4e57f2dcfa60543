"""Navigate a recorded car log: the 15-state filter on a Honeywell HGuide n380, beside the figures of KF-GINS for the same log.

    pip install onavdata==0.2.5
    python examples/navigate_a_log.py

Like KF-GINS it starts from the reference's state and takes the positions of GNSS alone.  The reference is the unit's own
solution from the same GNSS: the figures tell how well two filters agree, not how well either knows the truth.
"""

from pathlib import Path

from insenv import replay

LOG = Path(__file__).resolve().parent / "n380-car-position-only.toml"

report = replay(LOG, ["loosely-coupled"], start="reference")
result = report.results[0]
rms = result.statistics()["rms"]
source, published = report.published[0]

print(f"{report.title}: RMS from {result.from_s:g} s on")
print(f"published: {source}")
print(f"{'':12}{'insenv':>10}{'published':>11}")
for name in result.errors:
    print(f"{name:12}{rms[name]:10.4f}{published[name]:11.4f}")
