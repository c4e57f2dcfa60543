"""What `insenv campaign` does: Monte Carlo over seeds and ranges of a scenario's keys."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from insenv.errors import InputError

if TYPE_CHECKING:
    from insenv.campaigns.executors import Workers


def campaign(
    scenario: str,
    estimator_id: str,
    *,
    runs: int,
    seed: int | None,
    duration_s: float | None,
    vary: Sequence[str],
    workers: int | None,
    scheduler: str | None,
    out: Path | None,
    resume: bool,
    figure: bool,
    as_json: bool,
) -> None:
    """Run; print the tables; write the files."""
    from insenv.campaigns import Folder, make_plan, parse_variation, run_campaign
    from insenv.cli.output import print_json, print_line, print_parts, quiet_warnings, working
    from insenv.report import OutputFolder
    from insenv.report.campaign import campaign_document, campaign_tables, write_campaign
    from insenv.scenario import load

    if resume and out is None:
        raise InputError("--resume goes on with a folder: name it with --out DIR")
    makers = _workers(workers, scheduler)
    variations = [parse_variation(text) for text in vary]
    plan = make_plan(load(scenario), estimator_id, runs, first_seed=seed, duration_s=duration_s, variations=variations)
    folder = None if out is None else OutputFolder(out)
    store = None if folder is None else Folder(folder.path, plan, resume)
    with quiet_warnings(), working(f"{plan.name}, {plan.runs} runs") as progress:
        try:
            found = run_campaign(plan, store=store, workers=makers, progress=progress)
        except KeyboardInterrupt:
            kept = (
                "the blocks that are done are kept, and --resume goes on"
                if store
                else "nothing written: --out DIR would keep it"
            )
            raise KeyboardInterrupt(f"interrupted; {kept}") from None
        written = None if folder is None else write_campaign(found, folder, figure)
    paths = [str(path) for path in written.paths] if written else []
    if written and written.note:
        print_line(f"insenv: {written.note}", stderr=True)
    if as_json:
        print_json(campaign_document(found, paths))
        return
    print_parts(campaign_tables(found))
    print_line()
    if written:
        print_line(f"written to {written.paths[0].parent}: {', '.join(path.name for path in written.paths)}, blocks/")
    else:
        print_line("--out DIR keeps the figure, every run, and what --resume goes on from")


def _workers(workers: int | None, scheduler: str | None) -> Workers | None:
    from insenv.campaigns import cluster, processes

    if workers is not None and scheduler is not None:
        raise InputError("--workers and --scheduler: allowed is one of them")
    if scheduler is not None:
        return cluster(scheduler)
    return None if workers is None else processes(workers)
