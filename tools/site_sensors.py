"""Pages of the site for the sensors and for the grades of the catalogue: one each, and one above each group."""

from __future__ import annotations

import inspect

import numpy as np
from pages import imu_figures, key_table, markdown
from site_tables import Pages, overview, rows_with_bounds

from insenv.core.tables import Table
from insenv.geodesy import OMEGA_IE
from insenv.sensors import GNSS_GRADES, IMU_GRADES, ImuSection
from insenv.sensors import registry as sensors
from insenv.sensors.figures import Grade
from insenv.sensors.grades import ImuGrade
from insenv.sensors.imu_tables import IMU_PARAMETERS, IMU_STATE


def sensor_pages() -> Pages:
    """A page per sensor: the keys of its section, its parameter and state rows."""
    pages = {"sensors/imu.md": sensor("imu", "Inertial measurement unit", ImuSection, IMU_PARAMETERS, IMU_STATE)}
    found = {"imu": "the inertial measurement unit"}
    for id, section in sensors.registered().items():
        part = section.sensor.part(lambda p, x: (0, 0, 0))
        title = (inspect.getdoc(section) or id).partition("\n")[0]
        pages[f"sensors/{id}.md"] = sensor(id, title.rstrip("."), section, part.parameters, part.state + section.sensor.derived)
        found[id] = title
    intro = "The error models, their sources and their limits: [sensors](../../sensors.md)."
    rows = [[f"[`{id}`]({id}.md)", title] for id, title in found.items()]
    pages["sensors/index.md"] = overview("All sensors", intro, ("sensor", "what it is"), rows, found)
    return pages


def sensor(id: str, title: str, section: type, parameters: Table, state: Table) -> str:
    """The page of one sensor."""
    return (
        f"# `{id}`\n\n**{title}**\n\nIts equations: [sensors](../../sensors.md). A scenario has it as section `[{id}]`.\n\n"
        f"## Keys of `[{id}]`\n\n{key_table(section)}\n\n"
        f"## Parameters\n\n{rows_with_bounds(parameters)}\n\n## State and outputs\n\n{rows_with_bounds(state)}\n"
    )


def grades() -> Pages:
    """A page per grade of inertial units and receivers, and one above them."""
    pages = {f"grades/{name}.md": imu_grade(grade) for name, grade in IMU_GRADES.items()}
    pages |= {f"grades/gnss-{name}.md": gnss_grade(grade) for name, grade in GNSS_GRADES.items()}
    rows = [[f"[`{name}`]({name}.md)", "IMU", grade.title] for name, grade in IMU_GRADES.items()]
    rows += [[f"[`{name}`](gnss-{name}.md)", "GNSS", grade.title] for name, grade in GNSS_GRADES.items()]
    intro = (
        'A grade is a data sheet by name: `[imu] grade = "tactical"`, `[gnss] grade = "rtk"`. Every figure has its source. '
        "The grades that begin with `paper-` are the units of the papers."
    )
    files = [path.removeprefix("grades/").removesuffix(".md") for path in pages]
    pages["grades/index.md"] = overview("All grades", intro, ("grade", "of", "what it is"), rows, files)
    return pages


def imu_grade(grade: ImuGrade) -> str:
    """The page of a grade of inertial units."""
    figures = imu_figures(grade) or "All errors are zero."
    return (
        f'# `{grade.name}`\n\n**{grade.title}**\n\n```toml\n[imu]\ngrade = "{grade.name}"\n```\n\n{figures}\n\n'
        f"The figures in SI, by row: [the inertial unit](../sensors/imu.md).\n\n{what_the_biases_cost(grade)}"
    )


def what_the_biases_cost(grade: ImuGrade) -> str:
    """Tilt and heading of an alignment at rest that the biases of a grade leave (1 sigma), from Groves (2013), section 5.6."""
    rows = grade.parameters()

    def size(name: str) -> float:
        squares = [np.mean(np.square(rows.get(f"{name}_{kind}", 0.0))) for kind in ("bias", "bias_sigma", "instability_sigma")]
        return float(np.sqrt(sum(squares)))

    gyro, tilt = size("gyro"), size("accel") / 9.80665
    if gyro == 0.0 and tilt == 0.0:
        return ""
    heading = float(np.hypot(gyro / (OMEGA_IE * np.cos(np.pi / 4)), tilt))
    found = f"{np.degrees(heading):.2g} deg" if heading < 0.5 else "none: its bias hides the rotation of the Earth"
    return (
        "## What its biases leave of an alignment at rest\n\n"
        "One sigma, at latitude 45 deg, whatever the time: tilt = accelerometer bias / g; heading = gyro bias / "
        "(Earth rate x cos latitude), and the tilt x tan latitude.\n\n"
        + markdown(("tilt", "heading"), [[f"{np.degrees(tilt):.2g} deg", found]])
        + "\n"
    )


def gnss_grade(grade: Grade) -> str:
    """The page of a grade of receivers."""
    rows = [[f"`{key}`", ", ".join(f"{v:g}" for v in np.atleast_1d(value))] for key, value in grade.figures.items()]
    shown = f"{markdown(('figure, 1 sigma', 'value'), rows)}\n\nSource: {grade.source('')}." if rows else "No errors."
    section = f'[gnss]\ngrade = "{grade.name}"'
    return f"# GNSS `{grade.name}`\n\n**{grade.title}**\n\n```toml\n{section}\n```\n\n{shown}\n"
