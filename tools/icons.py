"""Draw the icons of the FMUs of plants: fmu/icons/NAME.png for each vehicle below; `plant` is any other.

python tools/icons.py
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import matplotlib as mpl
from matplotlib.figure import Figure
from matplotlib.patches import Circle, Ellipse, FancyArrowPatch, FancyBboxPatch, Polygon, Rectangle
from matplotlib.transforms import Affine2D

TEAL, NAVY, GREY, ORANGE = "#2a9d8f", "#1d3557", "#4a5a78", "#e9a33b"
FOLDER = Path(__file__).resolve().parent.parent / "fmu" / "icons"


def frame() -> tuple[Figure, Any]:
    """A figure of 200 x 200 pixels with the frame and the body axes; units: pixels from the lower left."""
    figure = Figure(figsize=(2, 2), dpi=100)
    axes = figure.add_axes((0, 0, 1, 1), xlim=(0, 200), ylim=(0, 200))
    axes.axis("off")
    box = FancyBboxPatch((10, 10), 180, 180, boxstyle="round,pad=0,rounding_size=14", fc="white", ec=TEAL, lw=3)
    axes.add_patch(box)
    for tip in ((128, 176), (166, 129), (110, 114)):
        axes.add_patch(
            FancyArrowPatch((128, 138), tip, arrowstyle="-|>", mutation_scale=9, color=ORANGE, lw=1.9, shrinkA=0, shrinkB=0)
        )
    return figure, axes


def polygon(axes: Any, corners: list[tuple[float, float]], colour: str, **options: Any) -> None:
    """A filled polygon."""
    axes.add_patch(Polygon(corners, closed=True, fc=colour, ec=NAVY, lw=1, **options))


def car(axes: Any) -> None:
    """A car on a road, seen from its right side."""
    axes.plot([22, 178], [38, 38], color=TEAL, lw=3)
    axes.plot([22, 178], [28, 28], color=TEAL, lw=2, alpha=0.5, dashes=(4, 2.5))
    polygon(axes, [(60, 82), (72, 106), (112, 106), (130, 82)], GREY)
    polygon(axes, [(36, 52), (34, 74), (44, 84), (136, 84), (160, 76), (164, 52)], NAVY)
    for x in (62, 138):
        axes.add_patch(Circle((x, 52), 14, fc=NAVY, ec="white", lw=2.5))
        axes.add_patch(Circle((x, 52), 5, fc="white"))


def aircraft(axes: Any) -> None:
    """An aircraft that climbs."""
    turn = Affine2D().rotate_deg_around(95, 75, 12) + axes.transData
    for patch in (
        Ellipse((95, 74), 138, 24, fc=NAVY, ec=NAVY, transform=turn),
        Polygon([(98, 72), (56, 36), (76, 36), (122, 72)], fc=GREY, ec="white", lw=1.5, transform=turn),
        Polygon([(50, 78), (28, 110), (42, 110), (70, 82)], fc=NAVY, ec=NAVY, transform=turn),
        Polygon([(58, 74), (26, 62), (36, 60), (72, 72)], fc=GREY, ec="white", lw=1, transform=turn),
    ):
        axes.add_patch(patch)
    for x, y in ((30, 30), (112, 40)):
        axes.plot([x, x + 42], [y, y], color=TEAL, lw=3, alpha=0.6, solid_capstyle="round")


def turntable(axes: Any) -> None:
    """A unit on a table that turns."""
    axes.add_patch(Rectangle((86, 26), 24, 28, fc=GREY, ec=NAVY, lw=1))
    polygon(axes, [(62, 20), (134, 20), (122, 32), (74, 32)], NAVY)
    axes.add_patch(Ellipse((98, 62), 128, 32, fc=NAVY, ec=NAVY))
    axes.add_patch(Ellipse((98, 68), 128, 32, fc="white", ec=NAVY, lw=2.5))
    polygon(axes, [(80, 66), (80, 96), (112, 96), (112, 66)], GREY)
    polygon(axes, [(112, 66), (112, 96), (124, 104), (124, 74)], NAVY)
    polygon(axes, [(80, 96), (92, 104), (124, 104), (112, 96)], "#8794ad")
    arc = FancyArrowPatch(
        (38, 88), (48, 46), connectionstyle="arc3,rad=0.5", arrowstyle="-|>", mutation_scale=11, color=TEAL, lw=3
    )
    axes.add_patch(arc)


def plant(axes: Any) -> None:
    """A unit, as a box."""
    polygon(axes, [(40, 34), (40, 88), (108, 88), (108, 34)], NAVY)
    polygon(axes, [(108, 34), (108, 88), (136, 106), (136, 52)], GREY)
    polygon(axes, [(40, 88), (68, 106), (136, 106), (108, 88)], "#8794ad")
    axes.plot([24, 176], [26, 26], color=TEAL, lw=3)


def main() -> None:
    """Write the icons."""
    mpl.use("agg")
    for draw in (car, aircraft, turntable, plant):
        figure, axes = frame()
        draw(axes)
        figure.savefig(FOLDER / f"{draw.__name__}.png", transparent=True, metadata={"Software": None})


if __name__ == "__main__":
    main()
