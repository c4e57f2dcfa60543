"""Align a swaying ship: simulate a scenario, run the q-method on it, and print each error with its theoretical limit.

python examples/align_a_ship.py
"""

import insenv

report = insenv.run("ship-swaying", "q-method", seed=1)
result = report.results[0]
rms = result.statistics()["rms"]

print(f"{report.title}, {report.duration_s:g} s; from {result.from_s:g} s on")
print(f"{'':12}{'rms':>10}{'limit':>10}")
for name, limit in result.limit.items():
    print(f"{name:12}{rms[name]:10.5f}{limit:10.5f}")
