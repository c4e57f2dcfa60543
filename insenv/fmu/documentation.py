"""documentation/index.html of an FMU: what it is, how it steps, and every variable, from the tables."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from html import escape

import numpy as np

import insenv
from insenv.fmu import units
from insenv.fmu.subject import EVENTS, Subject
from insenv.fmu.variables import Kind, Variable

_HEADINGS = {
    Kind.PARAMETER: "Parameters",
    Kind.INPUT: "Inputs",
    Kind.OUTPUT: "Outputs",
    Kind.CONSTANT: "Constants",
}
_STYLE = """
body { font: 15px/1.5 sans-serif; max-width: 60em; margin: 2em auto; padding: 0 1em; color: #222; }
table { border-collapse: collapse; width: 100%; font-size: 13px; }
th, td { text-align: left; vertical-align: top; padding: .2em .6em .2em 0; border-bottom: 1px solid #ddd; }
code { font-size: 95%; }
"""


def page(subject: Subject, variables: Sequence[Variable], fmi: int, libraries: Mapping[str, bytes]) -> str:
    """The page, as one HTML document without anything from outside."""
    parts = [
        f"<h1>{escape(subject.id)}</h1>",
        f"<p>{escape(subject.title[:1].upper() + subject.title[1:])}.</p>",
        f"<p>FMI {fmi}.0 for Co-Simulation, made by insenv {insenv.__version__}. The equations are C generated from the model "
        "that insenv itself runs; the results are the same to the bit. Nothing is needed but the C library.</p>",
        "<h2>Steps</h2>",
        f"<p>The sample interval is {subject.sample_interval!r} s, fixed at the export. A communication step is a whole number "
        "of samples; any other is refused with a message that says why, and nothing changes. Inputs are held over a step: "
        "with several samples in a step each sample gets the same inputs.</p>",
        *_further(subject, variables),
        "<p>A value that is not finite, and a parameter out of its bounds, is refused when it is set; an input out of its "
        "bounds when the step is made, unless a flag says that it is not used (<code>gnss_...</code> while "
        "<code>gnss_valid</code> is 0). The state can be saved, restored and serialized; all of it is kept, so that a "
        "continued run equals one without the break, to the bit.</p>",
        f"<p>{escape(subject.values_from)}</p>",
        "<p>Frames: n is north, east, down at the vehicle; b is forward, right, down, the axes of the inertial unit; e is "
        "fixed to the Earth (WGS-84); w is wander azimuth. Quaternions are Hamilton's, scalar first: <code>q_nb</code> takes "
        "components in b to components in n.</p>",
    ]
    for kind, heading in _HEADINGS.items():
        rows = [v for v in variables if v.kind is kind]
        if rows:
            parts += [f"<h2>{heading}</h2>", _table(rows)]
    names = ", ".join(f"<code>{escape(name)}</code>" for name in sorted(libraries))
    parts += [
        "<h2>Files</h2>",
        f"<p>Binaries: {names}. The sources are in <code>sources/</code>, C99 without a dependency; <code>fmpy compile</code> "
        "builds them for the machine that it runs on. Inputs and the outputs that belong to them are in "
        "<code>extra/org.fmi-standard.fmi-ls-ref/</code>. Licences are in <code>documentation/licenses/</code>.</p>",
    ]
    body = "\n".join(parts)
    head = f'<meta charset="utf-8">\n<title>{escape(subject.id)}</title>\n<style>{_STYLE}</style>'
    return f'<!DOCTYPE html>\n<html lang="en">\n<head>\n{head}\n</head>\n<body>\n{body}\n</body>\n</html>\n'


def _further(subject: Subject, variables: Sequence[Variable]) -> list[str]:
    """What is particular to a plant, or to the inputs that it has."""
    if subject.kind == "plant":
        return [
            "<p>Each sample moves the vehicle and gives what its inertial unit measured over it, the fix that came with it, if "
            "any, and the truth at its end. After a step of several samples the outputs are those of the last. Every random "
            "number is a function of <code>parameters.seed</code> and the number of the sample: the same on every machine.</p>"
        ]
    inputs = {v.row.name for v in variables if v.kind is Kind.INPUT}
    events = ", ".join(f"<code>{name}</code>" for name in EVENTS if name in inputs)
    texts = [
        "<p><code>delta_angle</code> and <code>delta_velocity</code> are the increments over one sample, the one that begins "
        "at the communication point: row k of a log is set at the time at which the sample begins. <code>dt</code> is the "
        "sample's interval as it was measured; left alone it is the sample interval.</p>"
    ]
    if events:
        texts.append(f"<p>In a step of several samples {events} is taken with the last of them.</p>")
    return texts


def _table(rows: Sequence[Variable]) -> str:
    lines = ["<table>", "<tr><th>Name</th><th>Unit</th><th>Start</th><th>Bounds</th><th>Meaning</th></tr>"]
    for v in rows:
        shape = f"[{' x '.join(map(str, v.row.shape))}]" if v.row.shape else ""
        kinds = ", ".join(units.parts(v.row))
        bounds = f"{v.row.lower:g} to {v.row.upper:g}" if np.isfinite([v.row.lower, v.row.upper]).all() else ""
        cells = [f"<code>{escape(v.name)}</code>{shape}", escape(kinds), _start(v), bounds, escape(v.description)]
        lines.append("<tr>" + "".join(f"<td>{cell}</td>" for cell in cells) + "</tr>")
    return "\n".join([*lines, "</table>"])


def _start(variable: Variable) -> str:
    if variable.start is None:
        return ""
    values = variable.start
    if values.size > 1 and (values == values[0]).all():
        values = values[:1]
    return " ".join(f"{value:.6g}" for value in values[:8]) + (" ..." if values.size > 8 else "")
