"""Print the drift of a mechanization on true increments, without engine and gusts: the tables of docs/truth.md (four
rates) and of docs/estimators/wander-sins.md (the exact and the plain form).
"""

from insenv.bench.truth import SCENARIOS, drift_ned

RATES_HZ = (50.0, 100.0, 200.0, 400.0)


def table() -> str:
    """Largest error of any axis after 10 minutes, mm, by vehicle and rate."""
    lines = ["| | " + " | ".join(f"{rate:g} Hz" for rate in RATES_HZ) + " |", "|---" * (1 + len(RATES_HZ)) + "|"]
    for vehicle in SCENARIOS:
        cells = [f"{drift_ned(vehicle, rate, disturbed=False).max():.2g}" for rate in RATES_HZ]
        lines.append(f"| {vehicle} | " + " | ".join(cells) + " |")
    return "\n".join(lines)


def plain() -> str:
    """Largest errors after 10 minutes, m: of `wander-sins` in any axis, of the plain form north, east, down at two rates."""
    lines = ["| | wander-sins, 200 Hz | plain, 200 Hz | plain, 400 Hz |", "|---|---|---|---|"]
    for vehicle, scenario in SCENARIOS.items():
        exact = drift_ned(vehicle, 200.0, disturbed=False).max() / 1e3
        forms = [drift_ned(vehicle, rate, False, "wander-sins-plain") / 1e3 for rate in (200.0, 400.0)]
        cells = [f"{exact:.5f}", *(", ".join(f"{error:.2f}" for error in form) for form in forms)]
        lines.append(f"| {scenario} | " + " | ".join(cells) + " |")
    return "\n".join(lines)


if __name__ == "__main__":
    print(table())
    print()
    print(plain())
