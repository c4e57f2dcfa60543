"""Print the table of docs/truth.md: drift of a mechanization on true increments, without engine and gusts, at four rates."""

from insenv.bench.truth import SCENARIOS, drift_ned

RATES_HZ = (50.0, 100.0, 200.0, 400.0)


def table() -> str:
    """Largest error of any axis after 10 minutes, mm, by vehicle and rate."""
    lines = ["| | " + " | ".join(f"{rate:g} Hz" for rate in RATES_HZ) + " |", "|---" * (1 + len(RATES_HZ)) + "|"]
    for vehicle in SCENARIOS:
        cells = [f"{drift_ned(vehicle, rate, disturbed=False).max():.2g}" for rate in RATES_HZ]
        lines.append(f"| {vehicle} | " + " | ".join(cells) + " |")
    return "\n".join(lines)


if __name__ == "__main__":
    print(table())
