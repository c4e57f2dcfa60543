"""Tables of rows, keys and estimators that the generated pages of the site share."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from math import inf

from pages import ROOT, markdown, rows_table

from insenv import estimators
from insenv.core.tables import Table
from insenv.estimators import Estimator
from insenv.estimators.settings import keys_by_row

DOCS = ROOT / "docs"
Pages = dict[str, str]
"""Text by path below docs/generated/."""
OWN_PAGE = ("fusion",)
"""Pages of estimators whose tables are so long that they stand on a page of their own."""


def overview(title: str, intro: str, head: Iterable[str], rows: Iterable[Iterable[str]], files: Iterable[str]) -> str:
    """The page above a group of pages: a table of links, and the hidden table of contents."""
    names = "\n".join(files)
    return f"# {title}\n\n{intro}\n\n{markdown(head, rows)}\n\n```{{toctree}}\n:hidden:\n:maxdepth: 1\n\n{names}\n```\n"


def estimators_on(text: str) -> list[Estimator]:
    """The estimators whose page this is: those that its first heading names."""
    title = text.partition("\n")[0]
    return [found for id, found in estimators.registered().items() if f"`{id}`" in title]


def estimator_tables(text: str) -> str:
    """The tables of the estimators of a page, to be appended to it; without parameters where the page has them itself."""
    lists_parameters = "<!-- begin parameters" in text
    return "\n\n".join(_estimator(found, lists_parameters) for found in estimators_on(text))


def interfaces() -> Pages:
    """The tables that have a page of their own, below which their estimators' page would be too long."""
    found = {}
    for page in OWN_PAGE:
        text = (DOCS / "estimators" / f"{page}.md").read_text(encoding="utf-8")
        names = text.partition(":")[0]
        about = f"What they do, and how they are used: [](../../estimators/{page}.md)."
        found[f"estimators/{page}.md"] = f"{names}: inputs and outputs\n\n{about}\n\n{estimator_tables(text)}"
    return found


def _estimator(estimator: Estimator, lists_parameters: bool) -> str:
    id, model = estimator.id, estimator.model
    keys = {row: ", ".join(f"`{key}`" for key in found) for row, found in keys_by_row(model.parameters).items()}
    parameters = (
        f'### Parameters of `{id}`\n\nA key sets the row in `[estimator."{id}"]` of a scenario or a log and in `settings`, in '
        f"the unit that its name ends with. Rows without one follow from what is known at the start.\n\n"
        f"{rows_with_bounds(model.parameters, keys)}\n\n"
    )
    return (
        f"## Interface of `{id}`\n\n"
        f"{sentence(estimator.title)} Kind: {estimator.kind}. Vehicle: {estimator.motion}. "
        f"Sensors beside the inertial unit: {', '.join(estimator.sensors) or 'none'}.\n\n"
        f"{'' if lists_parameters else parameters}"
        f"### Inputs of `{id}`\n\n{rows_with_bounds(model.inputs)}\n\n"
        f"### Outputs of `{id}`\n\n{rows_with_bounds(model.outputs)}\n"
    )


def rows_with_bounds(table: Table, keys: Mapping[str, str] | None = None) -> str:
    """The rows of a table with start values and bounds; `keys`: further cells by row name."""
    head = ["row", *(["key"] if keys is not None else []), "shape", "unit", "frame", "start", "bounds", "meaning"]
    plain = [line.split(" | ") for line in rows_table(table).splitlines()[2:]]
    rows = []
    for row, cells in zip(table, plain, strict=True):
        name, shape, unit, frame, start, meaning = (cell.strip("| ") for cell in cells)
        bounds = "" if (row.lower, row.upper) == (-inf, inf) else f"{row.lower:g} to {row.upper:g}"
        given = [keys.get(row.name, "")] if keys is not None else []
        rows.append([name, *given, shape, unit, frame, start, bounds, meaning.replace("\\|", "|")])
    used = [k for k, title in enumerate(head) if title in ("row", "meaning", "unit") or any(row[k] for row in rows)]
    return markdown([head[k] for k in used], ([row[k] for k in used] for row in rows))


def estimator_pages() -> dict[str, str]:
    """The hand-written page of each estimator, by id.  Raises ValueError for one that has none."""
    found = {
        estimator.id: path.name
        for path in sorted((DOCS / "estimators").glob("*.md"))
        for estimator in estimators_on(path.read_text(encoding="utf-8"))
    }
    missing = sorted(set(estimators.registered()) - set(found))
    if missing:
        raise ValueError(f"no page in docs/estimators/ names {', '.join(missing)} in its first heading")
    return found


def sentence(text: str) -> str:
    """A title as a sentence."""
    return f"{text[0].upper()}{text[1:]}."
