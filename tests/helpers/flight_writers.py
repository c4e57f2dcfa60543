"""Small writers of flight logs, by the published formats, for tests of the readers."""

import struct
from typing import Any

import numpy as np


class DataflashWriter:
    """ArduPilot dataflash: FMT messages, then records of a head, a number and packed fields."""

    CODES = {"B": "B", "h": "h", "H": "H", "I": "I", "Q": "Q", "f": "f", "N": "16s"}
    SCALED = {"c": ("h", 100), "C": ("H", 100), "e": ("i", 100), "L": ("i", 1e7)}

    STANDARD = {
        "IMT": ("QBfffffffff", "TimeUS,I,DelT,DelvT,DelaT,DelAX,DelAY,DelAZ,DelVX,DelVY,DelVZ"),
        "IMU": ("QBffffff", "TimeUS,I,GyrX,GyrY,GyrZ,AccX,AccY,AccZ"),
        "GPS": ("QBBIHBcLLeffffB", "TimeUS,I,Status,GMS,GWk,NSats,HDop,Lat,Lng,Alt,Spd,GCrs,VZ,Yaw,U"),
        "GPA": ("QBCCCCfBIH", "TimeUS,I,VDop,HAcc,VAcc,SAcc,YAcc,VV,SMS,Delta"), "ATT": ("Qccc", "TimeUS,Roll,Pitch,Yaw"),
        "POS": ("QLLf", "TimeUS,Lat,Lng,Alt"), "XKF1": ("QBfff", "TimeUS,C,VN,VE,VD"), "PARM": ("QNf", "TimeUS,Name,Value"),
        "MAG": ("QBhhh", "TimeUS,I,MagX,MagY,MagZ"), "BARO": ("QBff", "TimeUS,I,Alt,Press"),
    }  # fmt: skip

    def __init__(self, *names: str) -> None:
        """names: messages of `STANDARD` that are defined."""
        self.data = bytearray()
        self.kinds: dict[str, tuple[int, str, list[tuple[str, float | None]]]] = {}
        self._define("FMT", "BBnNZ", "Type,Length,Name,Format,Columns", 0x80, 89)
        for number, name in enumerate(names, start=0x20):
            form, columns = self.STANDARD[name]
            codes: list[tuple[str, float | None]] = [
                self.SCALED[letter] if letter in self.SCALED else (self.CODES[letter], None) for letter in form
            ]
            packed = "<" + "".join(code for code, _ in codes)
            self.kinds[name] = number, packed, codes
            self._define(name, form, columns, number, 3 + struct.calcsize(packed))

    def _define(self, name: str, form: str, columns: str, number: int, length: int) -> None:
        body = struct.pack("<BB4s16s64s", number, length, name.encode(), form.encode(), columns.encode())
        self.data += b"\xa3\x95\x80" + body

    def add(self, name: str, *values: float | bytes) -> None:
        number, packed, codes = self.kinds[name]
        whole = [round(v * f) if f else v for v, (_, f) in zip(values, codes, strict=True)]
        self.data += b"\xa3\x95" + bytes((number,)) + struct.pack(packed, *whole)


class UlogWriter:
    """PX4 ULog: header, flag bits, formats; then subscriptions and data messages."""

    STAMP = ("uint64_t", "timestamp")
    SAMPLED = ("uint64_t", "timestamp_sample")
    STANDARD = {
        "sensor_combined": [
            STAMP, ("float[3]", "gyro_rad"), ("uint32_t", "gyro_integral_dt"), ("int32_t", "accelerometer_timestamp_relative"),
            ("float[3]", "accelerometer_m_s2"), ("uint32_t", "accelerometer_integral_dt"),
        ],
        "vehicle_gps_position": [
            STAMP, SAMPLED, ("double", "latitude_deg"), ("double", "longitude_deg"), ("double", "altitude_msl_m"),
            ("double", "altitude_ellipsoid_m"), ("float", "s_variance_m_s"), ("float", "eph"), ("float", "epv"),
            ("float", "vel_n_m_s"), ("float", "vel_e_m_s"), ("float", "vel_d_m_s"), ("float", "heading"),
            ("float", "heading_accuracy"), ("uint8_t", "fix_type"), ("bool", "vel_ned_valid"),
        ],
        "vehicle_attitude": [STAMP, ("float[4]", "q")],
        "vehicle_local_position": [
            STAMP, *(("float", name) for name in ("x", "y", "z", "vx", "vy", "vz")), ("double", "ref_lat"),
            ("double", "ref_lon"), ("float", "ref_alt"), ("bool", "xy_global"), ("bool", "z_global"),
        ],
        "vehicle_magnetometer": [STAMP, SAMPLED, ("float[3]", "magnetometer_ga")],
        "vehicle_air_data": [STAMP, SAMPLED, ("float", "baro_alt_meter")],
    }  # fmt: skip
    SIZES = {"uint64_t": "Q", "float": "f", "double": "d", "int32_t": "i", "uint32_t": "I", "uint8_t": "B", "bool": "?"}

    def __init__(self, start_us: int = 0) -> None:
        self.data = bytearray(b"ULog\x01\x12\x35\x01" + struct.pack("<Q", start_us))
        self._message("B", bytes(40))
        self.packed: dict[str, struct.Struct] = {}

    def _message(self, kind: str, body: bytes) -> None:
        self.data += struct.pack("<HB", len(body), ord(kind)) + body

    def formats(self, *topics: str) -> None:
        """Those of `STANDARD`, in which a type may be an array as "float[3]"; then their subscriptions."""
        for name in topics:
            fields = self.STANDARD[name]
            self._message("F", (f"{name}:" + "".join(f"{kind} {field};" for kind, field in fields)).encode())
            letters = "<"
            for kind, _ in fields:
                base, _, count = kind.rstrip("]").partition("[")
                letters += (count or "") + self.SIZES[base]
            self.packed[name] = struct.Struct(letters)
        for number, name in enumerate(topics):
            self._message("A", struct.pack("<BH", 0, number) + name.encode())

    def add(self, name: str, *values: Any) -> None:
        flat = [item for value in values for item in (value if isinstance(value, (list, tuple, np.ndarray)) else [value])]
        self._message("D", struct.pack("<H", list(self.packed).index(name)) + self.packed[name].pack(*flat))

    def parameter(self, name: str, value: float) -> None:
        key = f"float {name}".encode()
        self._message("P", bytes((len(key),)) + key + struct.pack("<f", value))
