"""Navigate a recorded car log (Honeywell HGuide n380) with the 15-state filter, and compare with KF-GINS on the same log.

    pip install onavdata==0.2.5
    python examples/navigate_a_log.py

Like KF-GINS it starts from the state of the reference solution and uses only GNSS positions.  The reference is the unit's
own solution from the same GNSS: the errors measure the agreement of two filters, not the accuracy of either.
"""

import sys
from pathlib import Path

import insenv
from insenv.base.errors import InputError

LOG = Path(__file__).resolve().parent / "n380-car-position-only.toml"

try:
    report = insenv.replay(LOG, "loosely-coupled", start="reference")
except InputError as error:  # such as a missing package
    sys.exit(f"navigate_a_log.py: {error}")
result = report.results[0]
rms = result.statistics()["rms"]
source, published = report.published[0]

print(f"{report.title}: RMS from {result.from_s:g} s on")
print(f"published: {source}")
print(f"{'':12}{'insenv':>10}{'published':>11}")
for name in result.errors:
    print(f"{name:12}{rms[name]:10.4f}{published[name]:11.4f}")
