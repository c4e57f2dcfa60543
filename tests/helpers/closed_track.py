"""A smooth track in closed form, written to files, and the truth of a vehicle on it."""

import numpy as np

import insenv
from insenv.core.runner import make_runner
from insenv.scenario import build

LATITUDE, LONGITUDE = np.radians(45.0), np.radians(7.0)
ATTITUDE = {"roll": "roll", "pitch": "pitch", "heading": "heading"}
GPX = '<?xml version="1.0" encoding="UTF-8"?>\n<gpx version="1.1" creator="t" xmlns="http://www.topografix.com/GPX/1/1"><trk><trkseg>'


def closed_form(time):
    """Latitude, longitude (rad), height (m), roll, pitch, heading (rad) of a smooth track that is no spline."""
    w = 2.0 * np.pi
    return np.column_stack([
        LATITUDE + 2000.0 / 6.37e6 * np.sin(w * time / 300.0),
        LONGITUDE + 3000.0 / 6.37e6 * (1.0 - np.cos(w * time / 400.0)),
        300.0 + 50.0 * np.sin(w * time / 120.0),
        np.radians(10.0) * np.sin(w * time / 20.0),
        np.radians(5.0) * np.sin(w * time / 25.0),
        np.radians(170.0) + np.radians(100.0) * np.sin(w * time / 200.0),
    ])  # fmt: skip


def write_csv(path, time, values):
    table = np.column_stack([time, np.degrees(values[:, :2]), values[:, 2], np.degrees(values[:, 3:])])
    header = "time,latitude,longitude,height,roll,pitch,heading"
    np.savetxt(path, table, fmt="%.15g", delimiter=",", header=header, comments="")


def write_gpx(path, time, values, digits=7):
    points = []
    for t, (latitude, longitude, height) in zip(time, values[:, :3], strict=True):
        stamp = f"2026-01-01T{int(t) // 3600:02d}:{int(t) // 60 % 60:02d}:{t % 60:06.3f}Z"
        place = f'lat="{np.degrees(latitude):.{digits}f}" lon="{np.degrees(longitude):.{digits}f}"'
        points.append(f"<trkpt {place}><ele>{height:.2f}</ele><time>{stamp}</time></trkpt>")
    path.write_text(GPX + "\n".join(points) + "</trkseg></trk></gpx>", encoding="utf-8")


def scenario(path, **more):
    vehicle = {"kind": "recorded", "file": str(path), **more.pop("vehicle", {})}
    return insenv.load({"title": "t", "rate_hz": 100.0, "vehicle": vehicle, **more})


def truth_of(loaded, duration_s=None, seed=1):
    """Time (s) and rows of the truth of a run."""
    plant = build(loaded, seed=seed, duration_s=duration_s)
    shown = plant.model.outputs.unpack(make_runner(plant.model, plant.parameters).run(plant.samples))
    return (np.arange(plant.samples) + 1) * plant.sample_interval, {name: np.array(values) for name, values in shown.items()}
