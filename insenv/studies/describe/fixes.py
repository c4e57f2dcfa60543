"""The fixes of a log: which columns are latitude, longitude, height and velocity, their units, and their standard deviations.

An angle of a position moves by metres from fix to fix, in one of its units.  Velocities are the columns whose integral is the
way between the positions: their slope on it, of 1, shows unit and sign, and which angle is the latitude, because a degree of
longitude is shorter.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from insenv import geodesy
from insenv.core.tables import Array
from insenv.logs.text import repeats
from insenv.logs.units import ANGLE_UNITS
from insenv.studies.describe.agreement import Track
from insenv.studies.describe.finding import Finding, UnclearError, listed
from insenv.studies.describe.inertial import named_triads
from insenv.studies.describe.tables import LogTable

HIGHEST_M = 20_000.0
"""Height that a vehicle does not exceed: beyond it the column is not in metres."""
LARGEST_SPEED = 350.0
"""Speed (m/s) that a vehicle does not exceed."""
LARGEST_EXTENT = np.radians(20.0)
"""Extent of a track (rad)."""
FOLLOWS, SLOPE_OFF = 0.95, 0.1
"""Correlation with the way from which a column is a velocity, and part by which its slope may differ from 1."""
VERTICAL_FOLLOWS = 0.6
"""The same correlation of the vertical, whose way is short."""
WAY_S = 5.0
"""Time (s) over which ways are compared."""
SPACING_S = 4.0
"""Time (s) over which velocities are made of positions."""

VERTICAL = "gnss.velocity_vertical"

_LATITUDE, _LONGITUDE = re.compile(r"lat(?!e)", re.IGNORECASE), re.compile(r"lon|lng", re.IGNORECASE)
_ELLIPSOID, _SEA = re.compile(r"ell|hae", re.IGNORECASE), re.compile("msl|sea|geoid", re.IGNORECASE)
_RATE = re.compile("vel|speed", re.IGNORECASE)
_HEIGHT = re.compile(r"alt|height|hgt|elev|msl|(^|[^a-z])h([^a-z]|$)", re.IGNORECASE)
_SIGMA = re.compile(
    r"std|(^|[^a-z])sd|sig|acc(uracy)?($|[^a-z])|unc|err"
    r"|eph|epv|hacc|vacc|sacc|cov|var(iance)?($|[^a-z])|dop|(^|[^a-z])s[_ ]?v?[_ ]?(n|e|d|u|h)([^a-z]|$)",
    re.IGNORECASE,
)
_SPEED_SIGMA = re.compile(r"vel|(^|[^a-z])s(td|d|ig(ma)?)?[_ ]?v[_ ]?[nedu]|speed|sacc", re.IGNORECASE)
_COMPONENT = {
    0: re.compile(r"(^|[^a-z]|v|s|vel|std|sd|sig(ma)?)(n|north|lat)([^a-z]|$)|hacc|eph", re.IGNORECASE),
    1: re.compile(r"(^|[^a-z]|v|s|vel|std|sd|sig(ma)?)(e|east|lon)([^a-z]|$)|hacc|eph", re.IGNORECASE),
    2: re.compile(r"(^|[^a-z]|v|s|vel|std|sd|sig(ma)?)(d|down|u|up|h|hgt|height|alt)([^a-z]|$)|vacc|epv", re.IGNORECASE),
}
_UP = re.compile(r"(^|[^a-z]|v|vel)(u|up|climb)([^a-z]|$)|climb", re.IGNORECASE)
_DOWN = re.compile(r"(^|[^a-z]|v|vel)(d|down)([^a-z]|$)", re.IGNORECASE)


@dataclass(frozen=True)
class Fixes:
    """The columns of the fixes; velocity (north, east, vertical) and sigmas where there are any; vertical: "down" or "up" of
    the third velocity column, seen: whether the height shows it; track: the fixes in SI; findings: what is said of them."""

    latitude: int
    longitude: int
    height: int
    unit: str
    track: Track
    velocity: tuple[int, int, int] | None = None
    vertical: str = "down"
    position_sigma: tuple[int, int, int] | None = None
    velocity_sigma: tuple[int, int, int] | None = None
    findings: tuple[Finding, ...] = field(default=())

    @property
    def places(self) -> tuple[int, int, str]:
        """What says which fixes they are."""
        return self.latitude, self.longitude, self.unit

    @property
    def vertical_seen(self) -> bool:
        """Whether the height shows the direction of the third velocity."""
        return not any(each.key == VERTICAL and each.confidence != "measured" for each in self.findings)

    @property
    def upside_down(self) -> Fixes:
        """The same with the third velocity in the other direction."""
        assert self.track.velocity is not None
        track = replace(self.track, velocity=self.track.velocity * [1.0, 1.0, -1.0])
        return replace(self, vertical="up" if self.vertical == "down" else "down", track=track)

    def vertical_shown(self, evidence: str) -> Fixes:
        """The same with the direction of the third velocity as measured."""
        others = tuple(each for each in self.findings if each.key != VERTICAL)
        return replace(self, findings=(*others, Finding(VERTICAL, self.vertical, evidence)))


def angle_units(table: LogTable, column: int) -> list[str]:
    """Units in which a column may be an angle of a position."""
    values = table.values[:, column]
    values = values[np.isfinite(values)]
    if len(values) < 10 or np.ptp(values) == 0:
        return []
    steps = np.abs(np.diff(values))
    steps = steps[steps > 0]
    interval = _interval(table, column)
    units = []
    for unit, scale in ANGLE_UNITS.items():
        reach = np.pi * 2 / scale
        if np.abs(values).max() > reach or np.ptp(values) * scale > LARGEST_EXTENT or np.median(np.abs(values)) * scale < 1e-6:
            continue
        if unit == "1e-7 deg" and not (np.all(values == np.rint(values)) and np.abs(values).max() > 2e6):
            continue
        if unit != "1e-7 deg" and np.all(values == np.rint(values)):
            continue
        if np.median(steps) * scale * geodesy.A / interval < LARGEST_SPEED and np.ptp(values) * scale * geodesy.A > 0.02:
            units.append(unit)
    return units


def _interval(table: LogTable, column: int) -> float:
    """Time (s) between two different values of a column, in the median."""
    known = np.isfinite(table.values[:, column])
    values = table.values[known, column]
    new = np.flatnonzero(np.diff(values) != 0)
    seconds = table.seconds[known] if table.time >= 0 else np.arange(len(values), dtype=float)
    return max(float(np.median(np.diff(seconds[new + 1]))) if len(new) > 1 else 1.0, 1e-3)


def _says_nothing(table: LogTable, column: int) -> bool:
    """Whether the name of a column says nothing of a quantity: it has none, or one in words that are not known here."""
    if table.numbered(column):
        return True
    known = (_LATITUDE, _LONGITUDE, _HEIGHT, _RATE, _SIGMA, _SPEED_SIGMA, _UP, _DOWN, *_COMPONENT.values())
    of_triads = {each for triad in named_triads(table, ()) for each in triad}
    return column not in of_triads and not any(each.search(table.spoken(column)) for each in known)


def positions(table: LogTable) -> list[tuple[int, int, str]]:
    """What may be latitude and longitude: their columns and unit, those that names state first."""
    columns = [c for c in range(table.values.shape[1]) if c != table.time and not _SIGMA.search(table.spoken(c))]
    latitude = [c for c in columns if _LATITUDE.search(table.spoken(c))]
    longitude = [c for c in columns if _LONGITUDE.search(table.spoken(c))]
    pairs = [(a, b) for a in latitude for b in longitude if a != b]
    if not pairs:
        angles = [c for c in columns if _says_nothing(table, c) and angle_units(table, c)]
        pairs = [(a, b) for a in angles for b in angles if abs(a - b) == 1]
    candidates = []
    for a, b in pairs:
        for unit in angle_units(table, a):
            within = np.nanmax(np.abs(table.values[:, a])) * ANGLE_UNITS[unit] <= np.pi / 2
            if within and unit in angle_units(table, b):
                candidates.append((a, b, unit))
    return candidates


def fixes_of(table: LogTable) -> list[Fixes]:
    """What the fixes of a table may be; several where velocities do not decide, or the height not the sign of the vertical one.

    Raises `UnclearError` if there are none."""
    candidates = positions(table)
    if not candidates:
        raise UnclearError(f"{table.file}: no two columns are latitude and longitude in {listed(ANGLE_UNITS)}")
    made = [_with_height(table, *each) for each in candidates]
    sure = [each for each in made if each.velocity is not None]
    likely = sure or made
    return [*likely, *(each.upside_down for each in likely if each.velocity is not None and not each.vertical_seen)]


def _with_height(table: LogTable, latitude: int, longitude: int, unit: str) -> Fixes:
    columns = [c for c in range(table.values.shape[1]) if c not in (table.time, latitude, longitude)]
    height = _height(table, columns, max(latitude, longitude) + 1)
    rows = np.isfinite(table.values[:, [table.time, latitude, longitude, height]]).all(axis=1)
    time = table.seconds[rows]
    data = table.values[rows]
    usual = float(np.median(np.abs(data[:, height]))) if len(data) else 0.0
    if usual > HIGHEST_M:
        raise UnclearError(
            f"{table.file}: column {table.label(height)}, the height, is {usual:.6g} in the median (allowed "
            f"{HIGHEST_M:g} m): it is not in "
            "metres, which replay reads alone"
        )
    order = np.concatenate([[True], np.diff(time) > 0])
    time, data = time[order], data[order]
    again = repeats(time, data[:, [latitude, longitude, height]])
    if again is not None:
        time, data = time[again.rows], data[again.rows]
    place = data[:, latitude] * ANGLE_UNITS[unit], np.unwrap(data[:, longitude] * ANGLE_UNITS[unit]), data[:, height]
    track = Track(time, *place, spacing=SPACING_S)
    used = {table.time, latitude, longitude, height}
    free = [c for c in columns if c not in used and np.isfinite(data[:, c]).mean() > 0.95]
    velocity, vertical, findings = _velocity(table, track, data, [c for c in free if not _SIGMA.search(table.spoken(c))])
    if velocity is not None:
        signs = np.array([1.0, 1.0, 1.0 if vertical == "down" else -1.0])
        known = np.isfinite(data[:, velocity]).all(axis=1)
        latitudes, longitudes, elevations = (each[known] for each in place)
        track = Track(time[known], latitudes, longitudes, elevations, data[known][:, velocity] * signs, SPACING_S)
        lag, said = _velocity_lag(track)
        track, findings = replace(track, velocity_lag=lag), (*findings, *said)
        used |= set(velocity)
    free = [c for c in free if c not in used]
    sigma, speed_sigma = _sigmas(table, data, free, height, velocity)
    where = f"columns {table.label(latitude)}, {table.label(longitude)} move by at most metres from fix to fix in {unit}"
    findings = (
        Finding("gnss.latitude", table.refs[latitude], where),
        Finding("gnss.longitude", table.refs[longitude], where),
        *_height_findings(table, height, float(np.median(data[:, height]))),
        Finding("gnss.position_unit", unit, where),
        *findings,
    )
    return Fixes(latitude, longitude, height, unit, track, velocity, vertical, sigma, speed_sigma, findings)


def _height(table: LogTable, columns: Sequence[int], beside: int) -> int:
    """The column of the height: by its name, or the one `beside` the angles if it has none.  Raises `UnclearError`."""
    heights = [
        c
        for c in columns
        if _HEIGHT.search(table.spoken(c)) and not _SIGMA.search(table.spoken(c)) and not _RATE.search(table.spoken(c))
    ]
    heights = heights or [c for c in (beside,) if c in columns and _says_nothing(table, c)]
    if not heights:
        raise UnclearError(f"{table.file}: no column is the height; a description needs one (docs/logs.md)")
    return next((c for c in heights if _ELLIPSOID.search(table.spoken(c))), heights[0])


def _height_findings(table: LogTable, column: int, usual: float) -> tuple[Finding, ...]:
    """On the column of the height, which is `usual` (m), and on what it is above."""
    said = f"column {table.label(column)}, {usual:.5g} m in the median"
    finding = Finding("gnss.height", table.refs[column], said, "assumed" if _says_nothing(table, column) else "named")
    if _ELLIPSOID.search(table.spoken(column)):
        return (finding,)
    above = "its name says above the sea" if _SEA.search(table.spoken(column)) else "above the ellipsoid or the sea"
    geoid = f"{above}; if it is the sea, height_offset_m is the height of the geoid there above the ellipsoid"
    return finding, Finding("gnss.height_offset_m", None, geoid, "open")


def _ways(track: Track, lag: int) -> Array:
    places = (track.latitude, track.longitude, track.height)
    return np.asarray(geodesy.numeric.ned_offset(*(each[lag:] for each in places), *(each[:-lag] for each in places)))


def _velocity(
    table: LogTable, track: Track, data: Array, free: Sequence[int]
) -> tuple[tuple[int, int, int] | None, str, tuple[Finding, ...]]:
    """Columns of the velocity north, east and vertical, the direction of the last, and the evidence."""
    interval = track.interval
    lag = max(round(WAY_S / interval), 1)
    if len(track.time) < 4 * lag or len(free) < 3:
        return None, "down", ()
    took = track.time[lag:] - track.time[:-lag]
    fine = took < 1.5 * lag * interval
    way = _ways(track, lag)[fine]
    step = np.diff(track.time)[:, None]
    sums = np.vstack(
        [np.zeros(len(free)), np.cumsum(0.5 * (data[1:, free] + data[:-1, free]) * np.minimum(step, 3 * interval), axis=0)]
    )
    by_column = (sums[lag:] - sums[:-lag])[fine]
    picked: list[tuple[int, float, float]] = []
    for component in (0, 1):
        best = (0.0, -1, 0.0)
        for place in range(len(free)):
            follows, slope = _regression(by_column[:, place], way[:, component])
            if free[place] not in [each[0] for each in picked] and abs(follows) > abs(best[0]):
                best = follows, free[place], slope
        if abs(best[0]) < FOLLOWS:
            return None, "down", ()
        picked.append((best[1], best[0], best[2]))
    slopes = [each[2] for each in picked]
    if any(abs(slope - 1.0) > SLOPE_OFF for slope in slopes):
        said = (
            f"the integrals of columns {table.label(picked[0][0])}, {table.label(picked[1][0])} are {slopes[0]:.4g} and "
            f"{slopes[1]:.4g} times the way: "
            "their unit is not m/s, and replay reads no other; they are left out"
        )
        return None, "down", (Finding("gnss.velocity", None, said, "open"),)
    north, east = picked[0][0], picked[1][0]
    if _COMPONENT[1].search(table.spoken(north)) and _COMPONENT[0].search(table.spoken(east)):
        raise UnclearError(
            f"{table.file}: column {table.label(north)} follows the latitude and column {table.label(east)} the "
            f"longitude: the names of "
            "the positions or of the velocities are exchanged"
        )
    rest = [c for c in free if c not in (north, east)]
    verticals = {c: _regression(by_column[:, free.index(c)], way[:, 2]) for c in rest}
    fitting = [c for c, (follows, slope) in verticals.items() if abs(follows) > VERTICAL_FOLLOWS and 0.6 < abs(slope) < 1.5]
    named = [c for c in rest if _UP.search(table.spoken(c)) or _DOWN.search(table.spoken(c))]
    evidence = (
        f"the integrals of columns {table.label(north)}, {table.label(east)} are the way north and east: slopes "
        f"{slopes[0]:.3f}, "
        f"{slopes[1]:.3f}, correlations {picked[0][1]:.3f}, {picked[1][1]:.3f}"
    )
    beside = [c for c in (max(north, east) + 1,) if c in rest and table.numbered(c)]
    beside += [c for triad in named_triads(table, ()) if {north, east} < set(triad) for c in triad if c in rest]
    down = max(fitting, key=lambda c: abs(verticals[c][0]), default=None)
    if down is None:
        down = next(iter(named or beside), None)
    if down is None:
        return None, "down", (Finding("gnss.velocity", None, f"{evidence}; no column is the vertical one, so they are left out",
                                      "open"),)  # fmt: skip
    follows, slope = verticals[down]
    if down not in fitting and abs(follows) > FOLLOWS:
        raise UnclearError(
            f"{table.file}: the integral of column {table.label(down)} is {1 / abs(slope):.4g} times the change of the "
            f"height: either is "
            "not in metres"
        )
    if down in fitting:
        vertical = "down" if follows > 0 else "up"
        says = f"column {table.label(down)} is that {vertical}: slope {slope:.3f}, correlation {follows:.3f}"
        stated = "up" if _UP.search(table.spoken(down)) else "down" if _DOWN.search(table.spoken(down)) else vertical
        says += "" if stated == vertical else f"; its name says {stated}, which the height contradicts"
        sure = Finding(VERTICAL, vertical, says)
    else:
        vertical = "up" if _UP.search(table.spoken(down)) else "down"
        says = f"column {table.label(down)} stands for the vertical; the height changes too little to show its sign"
        sure = Finding(VERTICAL, vertical, says, "named" if down in named else "assumed")
    columns = (north, east, down)
    return columns, vertical, (Finding("gnss.velocity", [table.refs[c] for c in columns], evidence), sure)


MAX_LAG_S, LAG_STEP_S, LEAST_LAG_S = 0.5, 0.01, 0.02
"""Lags (s) of velocities behind positions that are tried, their step, and the smallest that is corrected."""
CLEAR = 2.0
"""Ratio of the mean squares without and with a lag from which it is one."""


def _velocity_lag(track: Track) -> tuple[float, tuple[Finding, ...]]:
    """The time (s) by which velocities lag the positions of the same stamps: a receiver may average or filter them."""
    assert track.velocity is not None
    took = np.diff(track.time)
    fine = took < 1.5 * track.interval
    rates, middle = (_ways(track, 1) / took[:, None])[fine][:, :2], (0.5 * (track.time[1:] + track.time[:-1]))[fine]
    lags = np.arange(-MAX_LAG_S, MAX_LAG_S + LAG_STEP_S / 2, LAG_STEP_S)
    means = []
    for lag in lags:
        shown = np.column_stack([np.interp(middle + lag, track.time, column) for column in track.velocity[:, :2].T])
        means.append(float(np.mean(np.minimum(np.sum((shown - rates) ** 2, axis=1), 25.0))))
    best = int(np.argmin(means))
    at_once = means[int(np.argmin(np.abs(lags)))]
    if abs(lags[best]) < LEAST_LAG_S or best in (0, len(lags) - 1) or at_once < CLEAR * means[best]:
        return 0.0, ()
    bend = means[best - 1] - 2 * means[best] + means[best + 1]
    lag = float(lags[best] + (0.5 * LAG_STEP_S * (means[best - 1] - means[best + 1]) / bend if bend > 0 else 0.0))
    off = (
        f"they differ from the way between positions by {np.sqrt(means[best]):.2g} m/s then, and by "
        f"{np.sqrt(at_once):.2g} m/s without"
    )
    return lag, (Finding("gnss.velocity_lag", None, f"the velocities show the motion of {1e3 * lag:.0f} ms before the "
                                                    f"positions of the same stamps: {off}; "
                         "time_offset_s is that of the positions, and velocity_sigma_mps allows for the lag"),)  # fmt: skip


def _regression(x: Array, y: Array) -> tuple[float, float]:
    """Correlation, and the slope of y on x (through 0, the smaller of both directions of regression would be biased)."""
    xx, yy, xy = float(x @ x), float(y @ y), float(x @ y)
    if xx <= 0 or yy <= 0:
        return 0.0, 0.0
    return xy / np.sqrt(xx * yy), float(np.sign(xy) * np.sqrt(yy / xx))


def _sigmas(
    table: LogTable, data: Array, free: Sequence[int], height: int, velocity: tuple[int, int, int] | None
) -> tuple[tuple[int, int, int] | None, tuple[int, int, int] | None]:
    """Columns of the standard deviations of position and velocity: by names, or the three after the height and after the
    velocity."""
    positive = [c for c in free if np.all(data[:, c] > 0)]
    if table.named:
        named = [
            c
            for c in positive
            if _SIGMA.search(table.spoken(c)) and not re.search("dop|cov|var", table.spoken(c), re.IGNORECASE)
        ]
        parts = (
            [c for c in named if not _SPEED_SIGMA.search(table.spoken(c))],
            [c for c in named if _SPEED_SIGMA.search(table.spoken(c))],
        )
        sigmas = []
        for part in parts:
            picked = [next((c for c in part if _COMPONENT[axis].search(table.spoken(c))), None) for axis in range(3)]
            sigmas.append(None if any(each is None for each in picked) else tuple(picked))
        return sigmas[0], sigmas[1] if velocity is not None else None  # type: ignore[return-value]
    after = [height + 1, (max(velocity) + 1) if velocity else -1]
    blocks = [tuple(range(begin, begin + 3)) for begin in after if begin > 0]
    blocks = [block for block in blocks if all(c in positive and not np.all(data[:, c] == np.rint(data[:, c])) for c in block)]
    of_place = next((block for block in blocks if block[0] == height + 1), None)
    if of_place is None and velocity is not None and height + 1 == min(velocity):
        of_place = next((block for block in blocks if block[0] == max(velocity) + 1), None)
        return of_place, None  # type: ignore[return-value]
    of_speed = next((block for block in blocks if block != of_place), None) if velocity else None
    return of_place, of_speed  # type: ignore[return-value]


# Standard deviations by the scatter of the fixes themselves.

LEAST_POSITION_M, LEAST_VELOCITY_MPS = 0.01, 0.02
"""Smallest standard deviations that are stated by scatter."""


def scatter(track: Track, residual: Array | None) -> tuple[Array, Array | None]:
    """Standard deviations (3,) of position (m) and velocity (m/s), N, E, D, by what changes from fix to fix.

    With velocities the way between two fixes is compared with them, and their changes with the samples; without, the positions
    are compared with the samples.  residual (n, 3) m/s: what the samples leave of these changes; None without samples.
    """
    speed = None if residual is None else np.array([_robust(column) for column in residual.T])
    if track.velocity is None:
        # smooth motion leaves something in both, so the smaller one holds
        third = np.diff(_ways(track, 1), n=2, axis=0)
        by_smoothness = np.array([_robust(column) / np.sqrt(20.0) for column in third.T])
        return np.maximum(
            by_smoothness
            if speed is None
            else np.minimum(by_smoothness, speed * track.spacing * np.sqrt(track.averaged / 6.0)),
            LEAST_POSITION_M,
        ), None
    took = np.diff(track.time)
    fine = took < 1.5 * track.interval
    shown = np.column_stack([np.interp(track.time + track.velocity_lag, track.time, column) for column in track.velocity.T])
    mean = 0.5 * (shown[1:] + shown[:-1])
    off = (_ways(track, 1) - mean * took[:, None])[fine]
    position = np.array([_robust(column) / np.sqrt(2.0) for column in off.T])
    if speed is None:
        speed = np.array([_robust(column) for column in np.diff(track.velocity, n=3, axis=0).T / np.sqrt(10.0)])
    late = np.sqrt(np.mean((shown - track.velocity) ** 2, axis=0))
    return np.maximum(position, LEAST_POSITION_M), np.maximum(np.hypot(speed / np.sqrt(2.0), late), LEAST_VELOCITY_MPS)


def _robust(values: Array) -> float:
    return float(np.median(np.abs(values - np.median(values))) / 0.6745)
