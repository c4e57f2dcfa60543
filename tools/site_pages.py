"""Pages of the documentation site that are made from the tables: `docs/conf.py` writes them into docs/generated/ at each build.

One page per environment, sensor, grade, scenario and public name. The tables of parameters, inputs and outputs of an
estimator are appended to its own page, `docs/estimators/`. All are Markdown except the reference, which is reStructuredText.
"""

from __future__ import annotations

import inspect
import re

import gymnasium
import thumbnails
from pages import ROOT, markdown
from site_sensors import grades, sensor_pages
from site_tables import DOCS, Pages, estimator_pages, interfaces, overview, rows_with_bounds, sentence

import insenv
from insenv.base.shipped import SPECS, titles
from insenv.scenario import load, summaries


def all_pages() -> Pages:
    """Every generated page."""
    return {**environments(), **sensor_pages(), **grades(), **scenarios(), **interfaces(), **reference()}


# --- environments ------------------------------------------------------------------------------------


def environments() -> Pages:
    """A page per environment: its docstring, its rows as declared, the scores of baselines that stand in docs/."""
    pages = {f"environments/{slug(id)}.md": environment(id) for id in SPECS}
    rows = [[f"[`{id}`]({slug(id)}.md)", title] for id, title in titles().items()]
    intro = (
        "Each page has the action, the observation and the info, row by row, and the scores of the baselines. "
        "How to use them: [environments](../../environments.md), [tuning and manoeuvres](../../tuning-and-manoeuvre.md)."
    )
    pages["environments/index.md"] = overview(
        "All environments", intro, ("environment", "task"), rows, [f"{slug(id)}" for id in SPECS]
    )
    return pages


def environment(id: str) -> str:
    """The page of one environment."""
    env = gymnasium.make(id, backend="interpreter").unwrapped
    setup = env.setup  # type: ignore[attr-defined]
    text = re.sub(r"\bdocs/([\w-]+)\.md\b", r"[\1](../../\1.md)", inspect.getdoc(type(env)) or "")
    scenario = str(SPECS[id][1]["scenario"])
    parts = (
        ("The action, row by row", setup.task.actions, "All components in [-1, 1]; the units are those of the table above."),
        ("The observation, row by row", setup.layout, f"With the default of {setup.samples} inertial samples per step."),
        ("The info, row by row", setup.task.info, "Only the info has the truth."),
    )
    declared = "\n\n".join(f"## {title}\n{note}\n\n{rows_with_bounds(table)}" for title, table, note in parts)
    return (
        f"# `{id}`\n\n{sentence(titles()[id])} Episodes of {setup.decisions} steps by default. "
        f"Default scenario: [`{scenario}`](../scenarios/{scenario}.md).\n\n{text}\n\n{declared}\n\n"
        f"## Baselines\n\n{baselines(id)}\n"
    )


def baselines(id: str) -> str:
    """The scores of an environment that stand in the hand-written pages, with a link to their conditions."""
    kind = str(SPECS[id][0])
    if kind in ("Alignment", "Navigation"):
        where, anchor, heading = "environments", "ranking-of-policies", "Ranking of policies"
        head, *rows = tables_below(where, heading)[kind == "Navigation"]
        column = head.index(str(SPECS[id][1]["vehicle"]))
        head, rows = ["policy", "score"], [[row[0], row[column]] for row in rows]
    else:
        where = "tuning-and-manoeuvre"
        heading = {
            "Tuning": "A trained tuner",
            "FaultTuning": "Instruments that fail",
            "Correction": "Errors taken out",
            "Manoeuvre": "Active alignment",
        }[kind]
        anchor = heading.lower().replace(" ", "-")
        head, *rows = tables_below(where, heading)[-1]
    return f"{markdown(head, rows)}\n\nConditions, seeds and how to repeat them: [{heading}](../../{where}.md#{anchor})."


def tables_below(page: str, heading: str) -> list[list[list[str]]]:
    """The Markdown tables below a heading of a page in docs/: tables of rows of cells, without the rule.

    Raises ValueError if there is none.
    """
    text = (DOCS / f"{page}.md").read_text(encoding="utf-8")
    section = re.search(rf"^## {re.escape(heading)}\n(.*?)(?=^## |\Z)", text, re.MULTILINE | re.DOTALL)
    blocks = re.findall(r"(?:^\|.*\n?)+", section[1], re.MULTILINE) if section else []
    if not blocks:
        raise ValueError(f"docs/{page}.md must have a table below the heading {heading!r}: the environments' pages show it")
    return [
        [[c.strip() for c in line.strip("| \n").split("|")] for k, line in enumerate(b.splitlines()) if k != 1] for b in blocks
    ]


# --- scenarios, public names -------------------------------------------------------------------------


def scenarios() -> Pages:
    """A page per scenario: what it is, and its file."""
    pages = {f"scenarios/{entry['name']}.md": scenario(entry["name"]) for entry in summaries()}
    rows = [
        [
            f"[`{s['name']}`]({s['name']}.md)",
            thumbnails.shown(s["name"], "../.."),
            s["vehicle"],
            f"{s['duration_s']:g} s",
            s["title"],
        ]
        for s in summaries()
    ]
    intro = "How to write your own: [scenarios](../../scenarios.md); [every key](../../scenario-keys.md)."
    names = [s["name"] for s in summaries()]
    pages["scenarios/index.md"] = overview(
        "All scenarios", intro, ("scenario", "track or sway, and an error", "vehicle", "duration", "title"), rows, names
    )
    return pages


def scenario(name: str) -> str:
    """The page of one scenario."""
    found = load(name)
    text = (ROOT / "scenarios" / f"{name}.toml").read_text(encoding="utf-8").rstrip()
    pages = estimator_pages()
    chosen = ", ".join(f"[`{id}`](../../estimators/{pages[id]})" for id in found.estimators)
    picture = thumbnails.shown(name, "../..")
    gnss = found.sensors.get("gnss")
    grade = getattr(gnss, "grade", "")
    rows = [
        ["vehicle", f"{found.vehicle.kind}, {'in place' if found.vehicle.in_place else 'moving'}"],
        ["duration, rate", f"{found.duration_s:g} s, {found.rate_hz:g} Hz"],
        ["start", f"latitude {found.start.latitude_deg:g} deg, heading {found.start.heading_deg:g} deg"],
        ["inertial unit", f"[`{found.imu.grade}`](../grades/{found.imu.grade}.md)"],
        ["GNSS", f"[`{grade}`](../grades/gnss-{grade}.md)" if gnss else "none"],
        ["other sensors", ", ".join(f"[`{id}`](../sensors/{id}.md)" for id in found.sensors if id != "gnss") or "none"],
        ["estimators", chosen or "none"],
    ]
    return (
        f"# `{name}`\n\n**{found.title}**\n\n{picture}\n\n{found.description.strip()}\n\n{markdown(('', ''), rows)}\n\n"
        f"```console\n$ insenv run {name}\n```\n\n## The file\n\n```toml\n{text}\n```\n"
    )


def reference() -> Pages:
    """A page per public name, from its docstring, and the conventions, which are the docstring of insenv."""
    pages = {}
    for name in insenv.__all__:
        thing = getattr(insenv, name)
        if inspect.ismodule(thing):
            body = f".. automodule:: {thing.__name__}\n   :members:\n"
        elif inspect.isclass(thing):
            body = f".. autoclass:: insenv.{name}\n   :members:\n"
            body += "\nKeys, units and defaults: :doc:`/scenario-keys`.\n" if hasattr(thing, "model_fields") else ""
        else:
            body = f".. autofunction:: insenv.{name}\n"
        pages[f"api/{name}.rst"] = f"insenv.{name}\n{'=' * (7 + len(name))}\n\n{body}"
    rest = (inspect.getdoc(insenv) or "").partition("\n")[2]
    pages["conventions.rst"] = f"Conventions\n===========\n\n{rest.strip().replace('`', '``').replace('````', '``')}\n"
    return pages


def slug(id: str) -> str:
    """``insenv/ShipAlignment-v0`` as the name of a file: ``ship-alignment``."""
    return re.sub(r"(?<!^)(?=[A-Z])", "-", id.removeprefix("insenv/").removesuffix("-v0")).lower()
