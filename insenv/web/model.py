"""The model of a page: a plant, one or several estimators behind it, and the numbers that the page shows of them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from types import SimpleNamespace
from typing import Any

import casadi as ca

from insenv import attitude, geodesy
from insenv.core.model import Model, Values
from insenv.core.tables import Row, Table
from insenv.estimators import Estimator
from insenv.evaluation.errors import DEGREES, channels_of, error_of, sigma_of, stated_of
from insenv.scenario.loop import loop_model

_ANGLES = "Roll, pitch and heading"
_OFFSET = "Offset from the start, north, east and down"


@dataclass(frozen=True, eq=False)
class Member:
    """One estimator of a page.

    prefix: of its rows.  channels: of its output ``PREFIXerror``.  stated: of its output ``PREFIXsigma``, if there are any.
    """

    estimator: Estimator
    prefix: str
    channels: tuple[str, ...]
    stated: tuple[str, ...]


@dataclass(frozen=True, eq=False)
class PageModel:
    """The model of a page.  Its rows begin with those of the plant, then come those of each member, with its prefix.

    Outputs after those: `attitude` (3, deg) and `offset_n` (3, m) of the truth; of each member, with its prefix,
    `attitude`, `offset_n` if it navigates, `error` and `sigma` by channel (deg, m, m/s).
    """

    plant: Model
    model: Model
    members: tuple[Member, ...]


@lru_cache(maxsize=16)
def page_model(plant: Model, estimators: tuple[Estimator, ...]) -> PageModel:
    """The model of a plant with estimators; the same object for the same arguments."""
    loop, members = plant, []
    for number, estimator in enumerate(estimators):
        prefix = f"e{number}_"
        loop = loop_model(loop, estimator.model, prefix)
        outputs = estimator.model.outputs
        members.append(Member(estimator, prefix, channels_of(outputs), stated_of(outputs)))
    rows = [Row("attitude", f"{_ANGLES}, true", "deg", (3,)), Row("offset_n", f"{_OFFSET}, true", "m", (3,))]
    for member in members:
        rows += _rows(member)

    def output(p: Values, x: Values) -> dict[str, Any]:
        outputs = dict(loop.output(p, x))
        truth = SimpleNamespace(**outputs)
        start = p.start_latitude, p.start_longitude, p.start_height
        outputs |= {"attitude": _euler(truth), "offset_n": _offset(truth, start)}
        for member in members:
            names = member.estimator.model.outputs.names
            estimate = SimpleNamespace(**{name: outputs[member.prefix + name] for name in names})
            outputs |= {member.prefix + name: value for name, value in _shown(member, estimate, truth, start).items()}
        return outputs

    model = replace(loop, id=f"page-{loop.id}", outputs=loop.outputs + Table(tuple(rows)), output=output)
    return PageModel(plant, model, tuple(members))


def _rows(member: Member) -> Sequence[Row]:
    of = f", {member.estimator.id}"
    rows = [Row("attitude", f"{_ANGLES}{of}", "deg", (3,))]
    if member.estimator.navigates:
        rows.append(Row("offset_n", f"{_OFFSET}{of}", "m", (3,)))
    rows.append(Row("error", f"Estimate minus truth{of}", "deg, m, m/s", (len(member.channels),)))
    if member.stated:
        rows.append(Row("sigma", f"Standard deviation that it states{of}", "deg, m, m/s", (len(member.stated),)))
    return [replace(row, name=member.prefix + row.name) for row in rows]


def _shown(member: Member, estimate: Values, truth: Values, start: tuple[Any, Any, Any]) -> dict[str, Any]:
    rows = {"attitude": _euler(estimate), "error": error_of(member.channels, estimate, truth)}
    if member.estimator.navigates:
        rows["offset_n"] = _offset(estimate, start)
    if member.stated:
        rows["sigma"] = sigma_of(member.stated, estimate)
    return rows


def _euler(v: Values) -> Any:
    return DEGREES * ca.vertcat(*attitude.to_euler(v.q_nb))


def _offset(v: Values, start: tuple[Any, Any, Any]) -> Any:
    return geodesy.ned_offset(v.latitude, v.longitude, v.height, *start)
