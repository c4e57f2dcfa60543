"""A recorded log in text files, written to a folder, changed and loaded."""

from pathlib import Path

import numpy as np
import pytest
from places import ROOT

from insenv.base.errors import InputError
from insenv.logs import RecordedLog, load

N = 100
RATE = 50.0
G = 9.80665
HEADER = "t,gx,gy,gz,ax,ay,az"
TOML = (ROOT / "tests" / "logs" / "data" / "changed.toml").read_text("utf-8")


def imu_rows(n: int = N) -> np.ndarray:
    """(n, 7): time [s], gyro [deg/s], accel [g]: distinct smooth signals on every axis."""
    t = 10.0 + np.arange(1, n + 1) / RATE
    gyro = [k * np.sin(0.3 * k * t) for k in (1, 2, 3)]
    accel = [0.1 * np.cos(t), 0.2 * np.sin(t), -1.0 + 0.01 * np.cos(2 * t)]
    return np.column_stack([t, *gyro, *accel])


def gnss_rows() -> np.ndarray:
    t = np.array([10.5, 11.5, 12.0])
    return np.column_stack([t, 45 + 1e-5 * t, -93 + 1e-5 * t, 200 + t, *np.full((3, 3), 0.5) * [[1], [2], [3]]])


def si(rows: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    return np.radians(rows[:, 1:4]), rows[:, 4:7] * G


def increments(rows: np.ndarray) -> np.ndarray:
    gyro, accel = si(rows)
    return np.column_stack([rows[:, 0], gyro / RATE, accel / RATE])


def as_text(rows: np.ndarray, header: str = "", sep: str = ",") -> str:
    lines = [sep.join(f"{v:.12g}" for v in row) for row in rows]
    return "\n".join(([header] if header else []) + lines) + "\n"


class Folder:
    """A log in a temporary folder; `load(...)` after changing its files."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.toml = TOML
        self.imu(imu_rows())
        self.write("gnss.csv", as_text(gnss_rows(), "t,lat,lon,h,sn,se,sd"))

    def write(self, name: str, text: str | bytes) -> None:
        (self.path / name).write_bytes(text.encode() if isinstance(text, str) else text)

    def imu(self, rows: np.ndarray, more: str = "") -> None:
        """Write the samples; more: names of further columns."""
        self.write("imu.csv", as_text(rows, HEADER + more))

    def change(self, *pairs: tuple[str, str]) -> None:
        """Replace texts of the description, each once."""
        for old, new in pairs:
            assert old in self.toml, old
            self.toml = self.toml.replace(old, new, 1)

    def hold_increments(self, angle: str) -> None:
        """Describe the samples as increments: angles in the unit `angle`, velocities in m/s."""
        self.change(('"rate"', '"increment"'), ('"deg/s"', f'"{angle}"'), ('accel_unit = "g"', 'accel_unit = "m/s"'))

    def fixes_in(self, file: str, offset_s: float, more: str = "") -> None:
        """Describe the fixes as those of a file whose format sets the keys, by an offset of its clock; more: further lines."""
        before = self.toml[: self.toml.index("[gnss]")]
        self.toml = f'{before}[gnss]\nfile = "{file}"\nlever_arm_m = [0, 0, 0]\ntime_offset_s = {offset_s}\n{more}'

    def fixes_in_the_imu_file(self, more: str = "") -> None:
        """Describe the fixes as columns lat, lon and h of the samples."""
        self.change(
            ('file = "gnss.csv"', f'file = "imu.csv"{more}'),
            ('position_sigma = ["sn", "se", "sd"]', "position_sigma_m = [1.0, 1.0, 2.0]"),
        )

    def line(self, name: str, number: int, text: str) -> None:
        lines = (self.path / name).read_text().split("\n")
        lines[number - 1] = text
        self.write(name, "\n".join(lines))

    def load(self) -> RecordedLog:
        self.write("log.toml", self.toml)
        return load(self.path / "log.toml")

    def error(self, *words: str) -> str:
        """The message of the error of loading, in which all the words stand."""
        with pytest.raises(InputError) as caught:
            self.load()
        missing = [word for word in words if word not in str(caught.value)]
        assert not missing, f"{missing} not in {caught.value}"
        return str(caught.value)
