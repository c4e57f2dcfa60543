"""ArduPilot dataflash logs (.BIN), by pymavlink's DFReader: messages IMU, IMT, GPS, GPA, ATT, POS, XKF1 or NKF1.

IMU holds filtered rates at instants, IMT increments over DelaT and DelvT. TimeUS is the autopilot's clock (TimeMS in logs of
2014); for a fix it is the time of logging, some tenths of a second after the time of validity (`gnss_time_offset_s`). Heights
are above mean sea level.
"""

from __future__ import annotations

import contextlib
import io
import os
import tempfile
from collections.abc import Iterator
from typing import Any

import numpy as np

from insenv.base.errors import InputError
from insenv.base.remarks import declared
from insenv.core.tables import Array
from insenv.logs.formats.contract import Format
from insenv.logs.formats.series import (
    FIX_3D,
    GAUSS,
    FixSeries,
    Flight,
    ImuSeries,
    Place,
    SolutionSeries,
    instance_name,
    nearest_rows,
    reading,
    three_sigmas,
    with_places,
)
from insenv.logs.recorded import NO_INFORMATION, Readings, course_velocity
from insenv.logs.units import WEEK_S, standard_height, unix_of_gps

HEAD = b"\xa3\x95"
_HEAD_BYTES = 3
_LATE = declared(
    "fixes-late", "fixes are stamped at logging, after their time of validity: a negative gnss_time_offset_s corrects it"
)


def read(label: str, data: bytes) -> Flight:
    """The series of a dataflash log. Raises InputError: not such a log, or not readable by DFReader."""
    if not data.startswith(HEAD):
        raise InputError(f"{label}: not an ArduPilot dataflash log: it must begin with the bytes A3 95")
    with _reader(label, data) as reader:
        tables = _Tables(reader, data)
        fixes = [series for name in tables.instances("GPS") if (series := tables.fixes(*name)) is not None]
        imus, others = tables.imus()
        return Flight(
            imus=imus,
            fixes=fixes,
            solutions=[tables.solution()],
            notes=[_LATE] if fixes else [],
            rows=sum(len(offsets) for offsets in reader.offsets),
            others=others,
            parameters=tables.parameters(),
            place=tables.place(),
            unix=tables.date(),
            readings=list(tables.readings()),
        )


@contextlib.contextmanager
def _reader(label: str, data: bytes) -> Iterator[Any]:
    """DFReader on the log. It reads only files, prints to the terminal, and can raise any exception."""
    from pymavlink.DFReader import DFReader_binary

    handle, path = tempfile.mkstemp(suffix=".BIN")
    reader = DFReader_binary.__new__(DFReader_binary)
    try:
        with open(handle, "wb") as file:
            file.write(data)
        try:
            with (
                contextlib.redirect_stderr(io.StringIO()),
                contextlib.redirect_stdout(io.StringIO()),
                _set("PYMAVLINK_FAST_INDEX", "0"),  # the fast index prints from C, which cannot be redirected
            ):
                reader.__init__(path)
        except Exception as error:
            raise InputError(f"{label}: not readable as an ArduPilot dataflash log: {error}") from None
        yield reader
    finally:
        for name in ("data_map", "filehandle"):  # DFReader leaves these open if it fails
            opened = getattr(reader, name, None)
            if opened is not None:
                opened.close()
        os.unlink(path)


@contextlib.contextmanager
def _set(name: str, value: str) -> Iterator[None]:
    """Set an environment variable within the block."""
    before = os.environ.get(name)
    os.environ[name] = value
    try:
        yield
    finally:
        if before is None:
            del os.environ[name]
        else:
            os.environ[name] = before


class _Tables:
    """The messages of a log as columns, scaled by the factors of their formats."""

    def __init__(self, reader: Any, data: bytes) -> None:
        self._reader, self._bytes = reader, np.frombuffer(data, np.uint8)
        self._cache: dict[str, dict[str, Array]] = {}

    def columns(self, name: str) -> dict[str, Array]:
        """Numeric columns by name, float64; empty if the log has no such message."""
        if name not in self._cache:
            self._cache[name] = self._read(name)
        return self._cache[name]

    def _read(self, name: str) -> dict[str, Array]:
        rows, factors = self._rows(name)
        result = {column: rows[column].astype(np.float64) * factor for column, factor in factors.items()}
        if "TimeUS" not in result and "TimeMS" in result:
            # in the GPS messages of 2014 TimeMS is the time of the GPS week, and T the time since boot
            result["TimeUS"] = result["T" if "Week" in result and "T" in result else "TimeMS"] * 1e3
        return result if "TimeUS" in result else {}

    def _rows(self, name: str) -> tuple[np.ndarray, dict[str, float]]:
        """The messages as a structured array, and the factor of each numeric column; no rows if the log has none."""
        from pymavlink.DFReader import FORMAT_TO_STRUCT

        none: tuple[np.ndarray, dict[str, float]] = np.zeros(0), {}
        number = self._reader.name_to_id.get(name)
        if number is None:
            return none
        form = self._reader.formats[number]
        offsets = np.asarray(self._reader.offsets[number], dtype=np.int64)
        offsets = offsets[offsets + form.len <= self._bytes.size]
        letters = [FORMAT_TO_STRUCT[letter] for letter in form.msg_fmts]
        fields = [
            (column, f"S{code[:-1]}" if code.endswith("s") else f"<{code}")
            for column, (code, _, _) in zip(form.columns, letters, strict=True)
        ]
        dtype = np.dtype(fields)
        if not offsets.size or dtype.itemsize + _HEAD_BYTES != form.len:
            return none
        rows = self._bytes[offsets[:, None] + np.arange(_HEAD_BYTES, form.len)].copy().view(dtype)[:, 0]
        factors = {
            column: float(factor or 1.0)
            for (column, code), (_, factor, _) in zip(fields, letters, strict=True)
            if not code.startswith("S")
        }
        return rows, factors

    def parameters(self) -> dict[str, float]:
        """PARM messages by name, the last value of each."""
        rows, factors = self._rows("PARM")
        if "Name" not in (rows.dtype.names or ()) or "Value" not in factors:
            return {}
        names = [bytes(name).decode("ascii", "replace") for name in rows["Name"]]
        return {name: float(value) for name, value in zip(names, rows["Value"], strict=True)}

    def place(self) -> Place | None:
        """The first origin of the autopilot's filter (ORGN)."""
        table = self.columns("ORGN")
        if not {"Lat", "Lng", "Alt"} <= set(table) or not table["Lat"].size:
            return None
        return Place(
            "ORGN", float(np.radians(table["Lat"][0])), float(np.radians(table["Lng"][0])), float(table["Alt"][0]), True
        )

    def date(self) -> float | None:
        """Unix time (s) of the middle of the GPS week of the first fix."""
        for name, instance in self.instances("GPS"):
            table = self.select(name, instance)
            week = next((table[column] for column in ("GWk", "Week") if column in table), np.zeros(0))
            if week.size and (week > 0).any():
                return float(unix_of_gps((week[week > 0][:1] + 0.5) * WEEK_S)[0])
        return None

    def instances(self, base: str) -> list[tuple[str, int | None]]:
        """(message, instance) of each sensor: by the column I, or by the number after the name in old logs."""
        instances: list[tuple[str, int | None]] = []
        for name in (base, f"{base}2", f"{base}3"):
            table = self.columns(name)
            if "I" in table:
                instances += [(name, int(i)) for i in np.unique(table["I"])]
            elif table:
                instances.append((name, None))
        return instances

    def select(self, name: str, instance: int | None) -> dict[str, Array]:
        """The rows of one instance."""
        table = self.columns(name)
        if instance is None or "I" not in table:
            return table
        chosen = table["I"] == instance
        return {column: values[chosen] for column, values in table.items()}

    # --- series ----------------------------------------------------------------------------------

    def imus(self) -> tuple[list[ImuSeries], list[str]]:
        imus, others = [], []
        for base in ("IMT", "IMU"):
            for name, instance in self.instances(base):
                table = self.select(name, instance)
                time = table["TimeUS"] * 1e-6
                label = instance_name(name, instance)
                if base == "IMT":
                    span = np.where((table["DelaT"] > 0) & (table["DelvT"] > 0), 1.0, np.nan)
                    rate = _three(table, "DelA") * (span / table["DelaT"].clip(1e-9))[:, None]
                    force = _three(table, "DelV") * (span / table["DelvT"].clip(1e-9))[:, None]
                    imus.append(ImuSeries(label, time, rate, force, "interval_end"))
                else:
                    imus.append(ImuSeries(label, time, _three(table, "Gyr"), _three(table, "Acc"), "instant"))
        for name in ("ISBH", "ACC", "GYR"):
            if self.columns(name):
                others.append(f"{name} (raw samples of one sensor each: not read)")
        return imus, others

    def fixes(self, name: str, instance: int | None) -> FixSeries | None:
        """Fixes of one receiver, with the accuracies from its GPA messages."""
        table = self.select(name, instance)
        if not {"Status", "Lat", "Lng", "Alt", "Spd", "GCrs", "VZ"} <= set(table):
            return None
        accuracy = self.select(name.replace("GPS", "GPA"), instance)
        good = table["Status"] >= FIX_3D
        table = {column: values[good] for column, values in table.items()}
        if not good.any():
            return None
        position_sigma, velocity_sigma = np.full((np.count_nonzero(good), 3), np.nan), None
        if {"HAcc", "VAcc", "SAcc"} <= set(accuracy) and accuracy["TimeUS"].size:
            at = nearest_rows(accuracy["TimeUS"], table["TimeUS"])
            horizontal, vertical, moving = (accuracy[column][at] for column in ("HAcc", "VAcc", "SAcc"))
            position_sigma = three_sigmas(horizontal, vertical)
            if (moving > 0).any():
                moving = np.where(moving > 0, moving, NO_INFORMATION)
                velocity_sigma = np.stack([moving] * 3, axis=1)
        return FixSeries(
            name=instance_name(name, instance),
            time=table["TimeUS"] * 1e-6,
            latitude=np.radians(table["Lat"]),
            longitude=np.radians(table["Lng"]),
            height=table["Alt"],
            height_sea=True,
            position_sigma=position_sigma,
            velocity_n=course_velocity(table["Spd"], np.radians(table["GCrs"]), table["VZ"]),
            velocity_sigma=velocity_sigma,
        )

    def readings(self) -> Iterator[Readings | None]:
        """The first magnetometer, less its offsets as the autopilot logs it, and the first barometer, by its pressure."""
        for base, id in (("MAG", "magnetometer"), ("BARO", "barometer")):
            for name, instance in self.instances(base)[:1]:
                table = self.select(name, instance)
                if id == "magnetometer" and {"MagX", "MagY", "MagZ"} <= set(table):
                    field = _three(table, "Mag") * 1e-3 * GAUSS
                    yield reading(id, instance_name(name, instance), table["TimeUS"] * 1e-6, field)
                if id == "barometer" and "Press" in table:
                    height = standard_height(table["Press"])
                    yield reading(id, instance_name(name, instance), table["TimeUS"] * 1e-6, height)

    def solution(self) -> SolutionSeries | None:
        """The autopilot's solution: attitude of ATT; position of POS and velocity of its first filter, if it has them."""
        attitude, place = self.columns("ATT"), self.columns("POS")
        filters = next((name for name in ("XKF1", "NKF1") if self.columns(name)), None)
        if not {"Roll", "Pitch", "Yaw"} <= set(attitude) or not attitude["TimeUS"].size:
            return None
        roll, pitch, heading = (np.radians(attitude[angle]) for angle in ("Roll", "Pitch", "Yaw"))
        alone = SolutionSeries(name="ATT", time=attitude["TimeUS"] * 1e-6, roll=roll, pitch=pitch, heading=heading)
        if not {"Lat", "Lng", "Alt"} <= set(place):
            return alone
        at, name, velocity = place["TimeUS"] * 1e-6, "ATT, POS", None
        if filters is not None:
            table, name = self.columns(filters), f"ATT, POS, {filters}"
            core = table.get("C", np.zeros(table["TimeUS"].size)) == 0
            moments = table["TimeUS"][core] * 1e-6
            inside = (at >= moments.min()) & (at <= moments.max())
            place, at = {column: values[inside] for column, values in place.items()}, at[inside]
            velocity = np.stack([np.interp(at, moments, table[v][core]) for v in ("VN", "VE", "VD")], axis=1)
        return with_places(
            alone,
            name,
            at,
            latitude=np.radians(place["Lat"]),
            longitude=np.radians(place["Lng"]),
            height=place["Alt"],
            height_sea=True,
            velocity_n=velocity,
        )


def _three(table: dict[str, Array], what: str) -> Array:
    return np.stack([table[f"{what}{axis}"] for axis in "XYZ"], axis=1)


FORMAT = Format(
    name="dataflash",
    kind="ArduPilot dataflash log",
    suffixes=(".BIN",),
    read_flight=read,
    hint="LOG_BITMASK selects what is logged: set its IMU and fast bits",
)
