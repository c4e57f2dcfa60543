"""documentation/index.html of an FMU: title, rules of stepping, and every variable; the template is fmu/index.html."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from html import escape
from string import Template

import numpy as np

from insenv.base.resources import fmu_folder
from insenv.base.shipped import __version__
from insenv.fmu.subject import Subject
from insenv.fmu.variables import Kind, Variable, parts, quantity

_HEADINGS = {
    Kind.PARAMETER: "Parameters",
    Kind.INPUT: "Inputs",
    Kind.OUTPUT: "Outputs",
    Kind.CONSTANT: "Constants",
}
_COLUMNS = ("Name", "Unit", "Shown in", "Start", "Bounds", "Meaning")
_ONE_SAMPLE, _SAMPLES = "A communication step is one sample.", "A communication step is a whole number of samples."
_COMMANDS = (
    "<p>The vehicle follows the scenario's script until <code>command_valid</code> is true; from then on it follows the inputs "
    "<code>command_...</code>. While <code>command_valid</code> is false they are not used.</p>\n"
)
_PLANT = (
    "<p>Each sample moves the vehicle; its outputs are the measurements of the inertial unit over the sample, the GNSS "
    "fix at its end, if any, and the truth at its end. After a step of several samples the outputs are those of the "
    "last. Every random number is a function of <code>parameters.seed</code> and the number of the sample, and the "
    "same on every machine.</p>"
)
_ESTIMATOR = (
    "<p><code>delta_angle</code> and <code>delta_velocity</code> are the increments over the sample that begins at the "
    "communication point: row k of a log is set at the time at which its sample begins. <code>dt</code> is the measured "
    "length of the sample, half to twice the step and on average the step within a tenth; its start value is the sample "
    "interval. <code>sample_number</code>, 0, 1, 2, ... by row of the log, lets each step check that the importer neither "
    "repeats, omits nor interpolates samples: connect it whenever the rows of a file are the inputs.</p>\n"
    "<p>With <code>parameters.step_is_one_increment</code> a step of any length is one sample: the inputs are the "
    "increments over the whole step, and <code>dt</code> becomes its length.</p>"
)


def page(subject: Subject, variables: Sequence[Variable], fmi: int, libraries: Iterable[str]) -> str:
    """The page as one self-contained HTML document; libraries: paths in the FMU."""
    by_kind = {kind: [v for v in variables if v.kind is kind] for kind in _HEADINGS}
    estimates, commands = subject.kind == "estimator", _COMMANDS if by_kind[Kind.INPUT] else ""
    tables = [f"<h2>{heading}</h2>\n{_table(by_kind[kind])}" for kind, heading in _HEADINGS.items() if by_kind[kind]]
    return Template((fmu_folder() / "index.html").read_text(encoding="utf-8")).substitute(
        id=escape(subject.id),
        title=escape(subject.title[:1].upper() + subject.title[1:]),
        fmi=fmi,
        version=__version__,
        sample_interval=repr(subject.sample_interval),
        length=_ONE_SAMPLE if estimates else _SAMPLES,
        further=_ESTIMATOR if estimates else commands + _PLANT,
        values_from=escape(subject.values_from),
        tables="\n".join(tables),
        binaries=", ".join(f"<code>{escape(name)}</code>" for name in sorted(libraries)),
    )


def _table(variables: Sequence[Variable]) -> str:
    lines = ["<table>", f"<tr>{''.join(f'<th>{name}</th>' for name in _COLUMNS)}</tr>"]
    for v in variables:
        units, shape = parts(v.row), " x ".join(map(str, v.row.shape))
        cells = (
            f"<code>{escape(v.name)}</code>{f'[{shape}]' if shape else ''}",
            "Boolean" if v.row.flag else escape(", ".join(units)),
            escape(", ".join(dict.fromkeys(filter(None, (quantity(v.row, unit).display for unit in units))))),
            _start(v),
            f"{v.row.lower:g} to {v.row.upper:g}" if np.isfinite([v.row.lower, v.row.upper]).all() else "",
            escape(v.description),
        )
        lines.append(f"<tr>{''.join(f'<td>{cell}</td>' for cell in cells)}</tr>")
    return "\n".join([*lines, "</table>"])


def _start(variable: Variable) -> str:
    if variable.start is None:
        return ""
    values = variable.start
    if values.size > 1 and (values == values[0]).all():
        values = values[:1]
    return " ".join(f"{value:.6g}" for value in values[:8]) + (" ..." if values.size > 8 else "")
