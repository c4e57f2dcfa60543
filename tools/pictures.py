"""Pictures of the concept pages as SVG: the architecture, drawn from the contract of layers in pyproject.toml, and the frames.

`python tools/pages.py` writes them into docs/figures/; a test compares. They are drawn in colours that are legible on a light
and on a dark page, and without a background.
"""

from __future__ import annotations

import ast
import re
import sys
from html import escape
from math import cos, radians, sin
from pathlib import Path
from typing import Any

if sys.version_info >= (3, 11):
    import tomllib
else:
    import tomli as tomllib

from insenv.scenario import build, load

ROOT = Path(__file__).resolve().parents[1]
FONT = "font-family='Helvetica, Arial, sans-serif'"
GROUPS = {
    "commands and studies": ("#3b6fb5", "cli bench reproduce testing studies runs web export report"),
    "interfaces": ("#8a5bb0", "mavlink board fmu envs"),
    "files that describe": ("#b8762a", "scenario extending"),
    "joining and judging": ("#2a8f7a", "logs evaluation"),
    "equations": ("#b8485a", "estimators sensors vehicles attitude geodesy"),
    "engine": ("#5c6b7a", "core base"),
}
"""Colour and packages of each group of layers; every package of the contract is in one."""
WIDTH, LEFT, BAND, GAP = 880, 190, 46, 8


def layers() -> list[list[str]]:
    """The packages of each layer, from the top down, as import-linter has them."""
    text = (ROOT / "pyproject.toml").read_text(encoding="utf-8")
    contracts: list[dict[str, Any]] = tomllib.loads(text)["tool"]["importlinter"]["contracts"]
    found = next(contract for contract in contracts if contract["type"] == "layers")
    return [re.split(r"\s*[|:]\s*", layer) for layer in found["layers"]]


def what_it_is(package: str) -> str:
    """The first line of the docstring of a package or module of insenv."""
    path = ROOT / "insenv" / package / "__init__.py"
    path = path if path.is_file() else ROOT / "insenv" / f"{package}.py"
    return (ast.get_docstring(ast.parse(path.read_text(encoding="utf-8"))) or "").partition("\n")[0]


def architecture() -> str:
    """The layers, from the top down: a package imports only from layers below its own.  Raises ValueError without a group."""
    group = {name: (title, colour) for title, (colour, names) in GROUPS.items() for name in names.split()}
    rows = layers()
    missing = [name for row in rows for name in row if name not in group]
    if missing:
        raise ValueError(f"tools/pictures.py: GROUPS must name {', '.join(missing)}")
    parts, last_title = [], ""
    for k, row in enumerate(rows):
        y = k * (BAND + GAP) + 4
        title, colour = group[row[0]]
        if title != last_title:
            parts.append(_text(LEFT - 16, y + 29, title, 15, colour, "end", "font-weight='bold'"))
            last_title = title
        each = (WIDTH - LEFT - 50 - GAP * (len(row) - 1)) / len(row)
        for i, name in enumerate(row):
            x = LEFT + i * (each + GAP)
            size = 15 if each > 110 else 12.5
            box = f"<rect x='{x:.0f}' y='{y}' width='{each:.0f}' height='{BAND}' rx='6' fill='{colour}'/>"
            short = clause(what_it_is(name)) if len(row) == 1 else ""
            label = _text(x + each / 2, y + (20 if short else 29), name, size, "#ffffff", "middle", "font-weight='bold'")
            label += _text(x + each / 2, y + 37, short, 12.5, "#ffffff", "middle") if short else ""
            parts.append(f"<g><title>{escape(what_it_is(name))}</title>{box}{label}</g>")
    height = len(rows) * (BAND + GAP)
    x = WIDTH - 30
    arrow = f"<path d='M {x} 10 V {height - 14} m -6 -12 l 6 12 l 6 -12' fill='none' stroke='#808a94' stroke-width='2.5'/>"
    down = f"<g transform='rotate(90 {x + 4} {height / 2})'>{_text(x + 4, height / 2, 'imports', 14, '#808a94', 'middle')}</g>"
    return _svg(WIDTH, height, "The layers of insenv", [*parts, arrow, down])


def clause(text: str) -> str:
    """What a docstring's first line says, without the name before its colon and what follows its first clause."""
    text = re.sub(r"^[`\w]+: ", "", text).replace("`", "")
    return re.split(r"[;:.](?:\s|$)", text)[0]


def sample_path() -> str:
    """The way of a number from a key of a scenario to C code, and of a sample from there to a table, with the code's values."""
    plant = build(load("car-odometer"), seed=1)
    section, table = plant.scenario.sensors["odometer"], plant.model.parameters
    value, place = section.rows(plant.scenario.rate_hz)["odometer_noise"], table.slice("odometer_noise").start
    boxes = (
        ("scenario file", "[odometer]", f'grade = "{section.grade}"', "scenario.files"),  # type: ignore[attr-defined]
        ("section", "keys, checked once", "noise_mps: 0 and more", "sensors.registry"),
        ("row", "odometer_noise", f"{float(value):g} m/s", "sensors.odometer"),
        ("vector", f"p[{place}]", f"one of {table.size} parameters", "core.tables"),
        ("equation", "measure(motion, errors, p)", "at the truth", "sensors.odometer"),
        ("C code", "step odometer", "also batch, FMU, page", "core.codegen"),
        ("sample", "odometer_speed", "output of the plant", "core.runner"),
        ("estimator", "measure(motion, errors, p)", "at the estimate", "estimators.fusion"),
        ("errors, limit", "measure(motion, errors, p)", "differentiated along the truth", "evaluation"),
        ("report", "table, page, JSON", "rms, limit, stated sigma", "report"),
    )
    colours = {package: colour for _, (colour, names) in GROUPS.items() for package in names.split()}
    width, height, gap, columns = 196, 104, 28, 4
    parts: list[str] = []
    for number, (title, first, second, module) in enumerate(boxes):
        row, column = divmod(number, columns)
        column = column if row % 2 == 0 else columns - 1 - column
        x, y = 8 + column * (width + gap), 8 + row * (height + gap)
        colour = colours[module.partition(".")[0]]
        parts.append(f"<rect x='{x}' y='{y}' width='{width}' height='{height}' rx='8' fill='{colour}'/>")
        lines = (
            (title, 16, "font-weight='bold'"),
            (first, 13, ""),
            (second, 13, ""),
            (f"insenv.{module}", 11.5, "opacity='0.8'"),
        )
        for place_of_line, (text, size, more) in enumerate(lines):
            parts.append(_text(x + width / 2, y + 24 + 23 * place_of_line, text, size, "#ffffff", "middle", more))
        if number + 1 < len(boxes):
            turns, back = (number + 1) % columns == 0, row % 2 == 1
            begin = (x + width / 2, y + height) if turns else (x, y + height / 2) if back else (x + width, y + height / 2)
            end = (begin[0], begin[1] + gap) if turns else (begin[0] + (-gap if back else gap), begin[1])
            parts.append(_arrow(begin[0], begin[1], end[0], end[1], "#808a94", "", (0, 0)))
    rows = -(-len(boxes) // columns)
    return _svg(16 + columns * (width + gap) - gap, 16 + rows * (height + gap) - gap, "From a key to a table", parts)


def frames() -> str:
    """The Earth with frames e and n, and a ship from above with frames n and b."""
    red, green, blue, grey, body = "#c8505a", "#2f9e6e", "#3f7fd0", "#808a94", "#b8762a"
    line = f"fill='none' stroke='{grey}'"
    cx, cy, r = 190, 190, 130
    lat = radians(40)
    px, py = cx + r * cos(lat), cy - r * sin(lat)
    up, north = (cos(lat), -sin(lat)), (-sin(lat), -cos(lat))
    parts = [
        f"<circle cx='{cx}' cy='{cy}' r='{r}' fill='{blue}' fill-opacity='0.12' stroke='{grey}' stroke-width='2'/>",
        f"<ellipse cx='{cx}' cy='{cy}' rx='{r}' ry='26' fill='none' stroke='{grey}' stroke-dasharray='5 5'/>",
        _arrow(cx, cy, cx, cy - r - 45, grey, "z e: rotation axis", (8, 4)),
        _arrow(cx, cy, cx + 62, cy + 52, grey, "x e: longitude 0", (6, 14)),
        f"<path d='M {cx} {cy} L {px:.0f} {py:.0f}' stroke='{grey}' stroke-dasharray='3 4'/>",
        f"<path d='M {cx + 45} {cy} A 45 45 0 0 0 {cx + 45 * cos(lat):.0f} {cy - 45 * sin(lat):.0f}' {line}/>",
        _text(cx + 50, cy - 3, "latitude", 13, grey),
        _arrow(px, py, px + 70 * north[0], py + 70 * north[1], red, "north", (-14, -8)),
        _arrow(px, py, px - 62 * up[0], py - 62 * up[1], green, "down", (-42, -4)),
        f"<circle cx='{px:.0f}' cy='{py:.0f}' r='7' fill='none' stroke='{body}' stroke-width='2.5'/>",
        f"<path d='M {px - 5:.0f} {py - 5:.0f} l 10 10 m 0 -10 l -10 10' stroke='{body}' stroke-width='2.5'/>",
        _text(px + 14, py + 6, "east (into the page)", 13, body),
    ]
    sx, sy, heading = 640, 200, 35
    forward = (sin(radians(heading)), -cos(radians(heading)))
    right = (-forward[1], forward[0])
    hull = "M 0 -80 C 34 -44 34 20 26 74 L -26 74 C -34 20 -34 -44 0 -80 Z"
    arc = f"M {sx} {sy - 92} A 92 92 0 0 1 {sx + 92 * forward[0]:.0f} {sy + 92 * forward[1]:.0f}"
    parts += [
        f"<path d='{hull}' transform='translate({sx} {sy}) rotate({heading})' fill='{grey}' fill-opacity='0.25'/>",
        _arrow(sx, sy, sx, sy - 150, red, "north", (8, 4)),
        _arrow(sx, sy, sx + 140, sy, body, "east", (6, 5)),
        _arrow(sx, sy, sx + 135 * forward[0], sy + 135 * forward[1], blue, "forward: x b", (8, -2)),
        _arrow(sx, sy, sx + 115 * right[0], sy + 115 * right[1], green, "right: y b", (8, 10)),
        f"<path d='{arc}' fill='none' stroke='{grey}' stroke-width='2'/>",
        _text(sx + 14, sy - 98, "heading", 13, grey),
        f"<circle cx='{sx}' cy='{sy}' r='9' fill='none' stroke='{grey}' stroke-width='2.5'/>",
        f"<path d='M {sx - 6} {sy - 6} l 12 12 m 0 -12 l -12 12' stroke='{grey}' stroke-width='2.5'/>",
        _text(sx - 16, sy - 8, "down: z n, z b (into the page)", 13, grey, "end"),
        _text(cx, 372, "the Earth: e and n", 15, grey, "middle"),
        _text(sx, 372, "a level ship from above: n and b", 15, grey, "middle"),
    ]
    return _svg(WIDTH, 385, "Frames e, n and b", parts)


def _arrow(x: float, y: float, to_x: float, to_y: float, colour: str, label: str, offset: tuple[float, float]) -> str:
    dx, dy = to_x - x, to_y - y
    length = (dx * dx + dy * dy) ** 0.5
    ux, uy = dx / length, dy / length
    head = " ".join(
        f"{to_x - 11 * ux + side * 5 * uy:.1f},{to_y - 11 * uy - side * 5 * ux:.1f}" for side in (1, -1)
    )  # fmt: skip
    line = f"<path d='M {x:.1f} {y:.1f} L {to_x - 8 * ux:.1f} {to_y - 8 * uy:.1f}' stroke='{colour}' stroke-width='2.5'/>"
    tip = f"<polygon points='{to_x:.1f},{to_y:.1f} {head}' fill='{colour}'/>"
    return line + tip + _text(to_x + offset[0], to_y + offset[1], label, 14, colour)


def _text(x: float, y: float, text: str, size: float, colour: str, anchor: str = "start", more: str = "") -> str:
    return (
        f"<text x='{x:.1f}' y='{y:.1f}' font-size='{size}' fill='{colour}' text-anchor='{anchor}' {more}>{escape(text)}</text>"
    )


def _svg(width: float, height: float, title: str, parts: list[str]) -> str:
    body = "\n".join(parts)
    return (
        f"<svg xmlns='http://www.w3.org/2000/svg' viewBox='0 0 {width} {height}' width='{width}' height='{height}' {FONT}>\n"
        f"<title>{title}</title>\n{body}\n</svg>\n"
    )
