"""documentation/index.html of an FMU: title, rules of stepping, and every variable."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from html import escape

import numpy as np

from insenv.base.version import __version__
from insenv.fmu import units
from insenv.fmu.subject import Subject
from insenv.fmu.variables import Kind, Variable

_HEADINGS = {
    Kind.PARAMETER: "Parameters",
    Kind.INPUT: "Inputs",
    Kind.OUTPUT: "Outputs",
    Kind.CONSTANT: "Constants",
}
_LENGTH = {
    "estimator": "A communication step is one sample.",
    "plant": "A communication step is a whole number of samples.",
    "loop": "A communication step is a whole number of samples.",
}
_COMMANDS = (
    "<p>The vehicle follows the scenario's script until <code>command_valid</code> is true; from then on it follows the inputs "
    "<code>command_...</code>. While <code>command_valid</code> is false they are not used.</p>"
)
_STYLE = """
body { font: 15px/1.5 sans-serif; max-width: 60em; margin: 2em auto; padding: 0 1em; color: #222; }
table { border-collapse: collapse; width: 100%; font-size: 13px; }
th, td { text-align: left; vertical-align: top; padding: .2em .6em .2em 0; border-bottom: 1px solid #ddd; }
code { font-size: 95%; }
"""


def page(subject: Subject, variables: Sequence[Variable], fmi: int, libraries: Mapping[str, bytes]) -> str:
    """The page as one self-contained HTML document."""
    parts = [
        f"<h1>{escape(subject.id)}</h1>",
        f"<p>{escape(subject.title[:1].upper() + subject.title[1:])}.</p>",
        f"<p>FMI {fmi}.0 for Co-Simulation, exported by insenv {__version__}. The equations are C code generated from "
        "the same model that insenv runs; the results are bit-identical. The C library is the only requirement.</p>",
        "<h2>Steps</h2>",
        f"<p>The sample interval is {subject.sample_interval!r} s, fixed at export. {_LENGTH[subject.kind]} Any other step is "
        "refused with a message and the state does not change; a step shorter than a millionth of a sample counts as done. "
        "Inputs are held over a step.</p>",
        *_further(subject, variables),
        "<p>A value that is not finite and a parameter outside its bounds are refused when they are set. An input outside its "
        "bounds is refused by the step. An input that a flag switches off (<code>gnss_...</code> while <code>gnss_valid</code> "
        "is false) may have any value, NaN too. The whole state can be saved, restored and serialized: a run that is continued "
        "from a saved state is bit-identical to an uninterrupted run.</p>",
        f"<p>{escape(subject.values_from)}</p>",
        "<p>Frames: n is north, east, down at the vehicle; b is forward, right, down, the axes of the inertial unit; e is "
        "Earth-fixed (WGS-84); w is wander azimuth. Quaternions are Hamilton quaternions, scalar first: <code>q_nb</code> "
        "transforms components in b to components in n.</p>",
    ]
    for kind, heading in _HEADINGS.items():
        rows = [v for v in variables if v.kind is kind]
        if rows:
            parts += [f"<h2>{heading}</h2>", _table(rows)]
    names = ", ".join(f"<code>{escape(name)}</code>" for name in sorted(libraries))
    parts += [
        "<h2>Files</h2>",
        f"<p>Binaries: {names}. The sources are in <code>sources/</code>, C99 without dependencies; <code>fmpy compile</code> "
        "builds them for the machine that it runs on. Reference inputs and outputs are in "
        "<code>extra/org.fmi-standard.fmi-ls-ref/</code>. Licences are in <code>documentation/licenses/</code>.</p>",
    ]
    body = "\n".join(parts)
    head = f'<meta charset="utf-8">\n<title>{escape(subject.id)}</title>\n<style>{_STYLE}</style>'
    return f'<!DOCTYPE html>\n<html lang="en">\n<head>\n{head}\n</head>\n<body>\n{body}\n</body>\n</html>\n'


def _further(subject: Subject, variables: Sequence[Variable]) -> list[str]:
    """Paragraphs that hold for a plant, or for an estimator with these inputs."""
    if subject.kind != "estimator":
        commands = [v for v in variables if v.kind is Kind.INPUT]
        return [
            *([_COMMANDS] if commands else []),
            "<p>Each sample moves the vehicle; its outputs are the measurements of the inertial unit over the sample, the GNSS "
            "fix at its end, if any, and the truth at its end. After a step of several samples the outputs are those of the "
            "last. Every random number is a function of <code>parameters.seed</code> and the number of the sample, and the "
            "same on every machine.</p>",
        ]
    return [
        "<p><code>delta_angle</code> and <code>delta_velocity</code> are the increments over the sample that begins at the "
        "communication point: row k of a log is set at the time at which its sample begins. <code>dt</code> is the measured "
        "length of the sample, half to twice the step; its start value is the sample interval.</p>",
        "<p>With <code>parameters.step_is_one_increment</code> a step of any length is one sample: the inputs are the "
        "increments over the whole step, and <code>dt</code> becomes its length.</p>",
    ]


def _table(rows: Sequence[Variable]) -> str:
    lines = ["<table>", "<tr><th>Name</th><th>Unit</th><th>Shown in</th><th>Start</th><th>Bounds</th><th>Meaning</th></tr>"]
    for v in rows:
        shape = f"[{' x '.join(map(str, v.row.shape))}]" if v.row.shape else ""
        kinds = ", ".join(units.parts(v.row))
        bounds = f"{v.row.lower:g} to {v.row.upper:g}" if np.isfinite([v.row.lower, v.row.upper]).all() else ""
        kinds = "Boolean" if v.row.flag else kinds
        shown = ", ".join(dict.fromkeys(filter(None, (units.quantity(v.row, unit).display for unit in units.parts(v.row)))))
        cells = [
            f"<code>{escape(v.name)}</code>{shape}",
            escape(kinds),
            escape(shown),
            _start(v),
            bounds,
            escape(v.description),
        ]
        lines.append("<tr>" + "".join(f"<td>{cell}</td>" for cell in cells) + "</tr>")
    return "\n".join([*lines, "</table>"])


def _start(variable: Variable) -> str:
    if variable.start is None:
        return ""
    values = variable.start
    if values.size > 1 and (values == values[0]).all():
        values = values[:1]
    return " ".join(f"{value:.6g}" for value in values[:8]) + (" ..." if values.size > 8 else "")
