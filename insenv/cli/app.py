"""The command line's grammar: each command gives the work to be done, which `insenv.cli.main` then does."""

from __future__ import annotations

from collections.abc import Callable
from enum import Enum
from functools import partial
from pathlib import Path
from typing import Annotated, Optional

import typer

from insenv.cli import commands, fmu

Work = Callable[[], None]

app = typer.Typer(
    add_completion=False,
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"]},
    help="Simulate vehicles with inertial sensors, and align and navigate them.",
    epilog="Exit status: 0 done, 1 the work failed, 2 the call was wrong, 130 interrupted.",
)

app.add_typer(fmu.app, name="fmu")

Json = Annotated[bool, typer.Option("--json", help="Print one JSON document on stdout and nothing else.")]
Out = Annotated[
    Optional[Path],  # noqa: UP045 - older versions of typer read no unions
    typer.Option("--out", "-o", metavar="DIR", help="Write the results (.npz, .json) and the figure (.png, .svg) there."),
]
NoFigure = Annotated[bool, typer.Option("--no-figure", help="With --out: write no figure.")]
Estimators = Annotated[
    Optional[list[str]],  # noqa: UP045
    typer.Option("--estimator", "-e", metavar="ID", help="Estimator to run; may be given more than once."),
]


class Start(str, Enum):
    """How a replay starts."""

    coarse = "coarse"
    reference = "reference"


class Lockstep(str, Enum):
    """What `insenv stream` keeps step with."""

    px4 = "px4"
    ardupilot_json = "ardupilot-json"


@app.callback(invoke_without_command=True)
def root(
    context: typer.Context,
    version: Annotated[bool, typer.Option("--version", help="Print the version and exit.", is_eager=True)] = False,
) -> None:
    if version:
        from insenv import __version__

        print(f"insenv {__version__}")
        raise typer.Exit(0)
    if context.invoked_subcommand is None:
        print(context.get_help())
        raise typer.Exit(2)


@app.command("list")
def list_(json: Json = False) -> Work:
    """List the scenarios, estimators and sensor grades."""
    return partial(commands.list_all, as_json=json)


@app.command()
def run(
    scenario: Annotated[str, typer.Argument(metavar="SCENARIO", help="A name that `insenv list` shows, or a .toml file.")],
    estimator: Estimators = None,
    seed: Annotated[Optional[int], typer.Option(metavar="N", help="Instead of the scenario's seed.")] = None,  # noqa: UP045
    duration: Annotated[
        Optional[float],  # noqa: UP045
        typer.Option(metavar="S", help="Seconds, instead of the scenario's."),
    ] = None,
    out: Out = None,
    no_figure: NoFigure = False,
    json: Json = False,
) -> Work:
    """Simulate a scenario and run estimators on it; print every error beside its theoretical limit."""
    return partial(
        commands.run,
        scenario,
        estimator or [],
        seed=seed,
        duration_s=duration,
        out=out,
        figure=not no_figure,
        as_json=json,
    )


@app.command()
def replay(
    log: Annotated[Path, typer.Argument(metavar="LOG", help="A flight log, or a .toml file that describes a log.")],
    estimator: Estimators = None,
    start: Annotated[Start, typer.Option(help="Start from the log alone, or from the state of its reference.")] = Start.coarse,
    out: Out = None,
    no_figure: NoFigure = False,
    json: Json = False,
) -> Work:
    """Run a recorded log through estimators; print the errors against its reference."""
    if not estimator:
        raise typer.BadParameter("name an estimator with -e ID; `insenv list` shows them")
    return partial(commands.replay, log, estimator, start=start.value, out=out, figure=not no_figure, as_json=json)


@app.command()
def bench(
    only: Annotated[Optional[str], typer.Option(metavar="PREFIX", help="Only figures whose name begins so.")] = None,  # noqa: UP045
    json: Json = False,
) -> Work:
    """Measure speed and accuracy on this machine, each figure beside its floor."""
    return partial(commands.bench, only, as_json=json)


@app.command()
def schema(json: Annotated[bool, typer.Option("--json", help="The same: the schema is JSON.")] = False) -> Work:
    """Print the JSON schema of a scenario file, for editors."""
    return commands.schema


@app.command()
def reproduce(
    paper: Annotated[Optional[str], typer.Argument(metavar="[PAPER]", help="One paper; all of them if left out.")] = None,  # noqa: UP045
    out: Out = None,
    json: Json = False,
) -> Work:
    """Measure the papers' tests again: published beside ours beside the theoretical limit."""
    return partial(commands.reproduce, paper, out=out, as_json=json)


@app.command()
def train(
    estimator: Annotated[str, typer.Argument(metavar="ESTIMATOR", help="What is trained: lssvm.")],
    scenario: Annotated[list[str], typer.Argument(metavar="SCENARIO...", help="Scenarios to learn from.")],
    seeds: Annotated[str, typer.Option(metavar="A-B", help="Seeds of the runs, first to last.")] = "9001-9080",
    duration: Annotated[
        Optional[float],  # noqa: UP045
        typer.Option(metavar="S", help="Seconds a run, instead of the scenario's."),
    ] = None,
    support: Annotated[Optional[int], typer.Option(metavar="N", help="Support vectors, fewer than there is room for.")] = None,  # noqa: UP045
    out: Annotated[Path, typer.Option("--out", "-o", metavar="FILE", help="The file to write.")] = Path("lssvm.json"),
    json: Json = False,
) -> Work:
    """Train an estimator that learns, on simulated runs of a filter; write it to a file (docs/estimators/lssvm.md)."""
    from insenv.cli.train import train as work

    return partial(work, estimator, scenario, seeds=seeds, duration_s=duration, support=support, out=out, as_json=json)


@app.command()
def stream(
    scenario: Annotated[str, typer.Argument(metavar="SCENARIO", help="A name that `insenv list` shows, or a .toml file.")],
    to: Annotated[
        Optional[str],  # noqa: UP045
        typer.Option(
            metavar="ADDRESS",
            help="udpout:HOST:PORT, udpin:..., tcpin:..., tcpout:... or serial:DEVICE:BAUD; without a HOST this machine alone.",
        ),
    ] = None,
    estimator: Annotated[
        Optional[str],  # noqa: UP045
        typer.Option("--estimator", "-e", metavar="ID", help="Estimator to run, instead of the scenario's first."),
    ] = None,
    seed: Annotated[Optional[int], typer.Option(metavar="N", help="Instead of the scenario's seed.")] = None,  # noqa: UP045
    speed: Annotated[float, typer.Option(metavar="X", help="Simulated seconds a second; 0: as fast as possible.")] = 1.0,
    duration: Annotated[
        Optional[float],  # noqa: UP045
        typer.Option(metavar="S", help="Simulated seconds; without it until Ctrl-C, or with --speed 0 the scenario's."),
    ] = None,
    tlog: Annotated[Optional[Path], typer.Option(metavar="FILE", help="Write a telemetry log.")] = None,  # noqa: UP045
    rate: Annotated[
        Optional[list[str]],  # noqa: UP045
        typer.Option(metavar="MESSAGE=HZ", help="Rate of a message, 0 for none; may be given more than once."),
    ] = None,
    signing_key_file: Annotated[
        Optional[Path],  # noqa: UP045
        typer.Option(metavar="FILE", help="Sign what is sent, and take only what is signed, with the key in this file."),
    ] = None,
    lockstep: Annotated[
        Optional[Lockstep],  # noqa: UP045
        typer.Option(help="Go sample by sample with an autopilot that connects (docs/lockstep.md)."),
    ] = None,
    json: Json = False,
) -> Work:
    """Stream the simulated vehicle and its estimate live over MAVLink, to ground stations and other clients."""
    from insenv.cli.stream import stream as work

    if lockstep is not None:
        from insenv.cli.lockstep import lockstep as in_step

        if signing_key_file is not None or speed != 1.0:
            raise typer.BadParameter("--lockstep: autopilots do not sign, and set the pace themselves")
        return partial(
            in_step,
            scenario,
            estimator,
            kind=lockstep.value,
            to=to,
            seed=seed,
            duration_s=duration,
            tlog=tlog,
            rates=rate or [],
            as_json=json,
        )
    if to is None:
        raise typer.BadParameter("--to ADDRESS is missing, such as --to udpout:127.0.0.1:14550")
    return partial(
        work,
        scenario,
        estimator,
        to=to,
        seed=seed,
        speed=speed,
        duration_s=duration,
        tlog=tlog,
        rates=rate or [],
        signing_key_file=signing_key_file,
        as_json=json,
    )


@app.command()
def campaign(
    scenario: Annotated[str, typer.Argument(metavar="SCENARIO", help="A name that `insenv list` shows, or a .toml file.")],
    estimator: Annotated[str, typer.Option("--estimator", "-e", metavar="ID", help="Estimator to run.")],
    runs: Annotated[int, typer.Option("--runs", "-n", metavar="N", help="Number of runs.")],
    seed: Annotated[
        Optional[int],  # noqa: UP045
        typer.Option(metavar="FIRST", help="Seed of the first run, instead of the scenario's; the next has the next."),
    ] = None,
    duration: Annotated[
        Optional[float],  # noqa: UP045
        typer.Option(metavar="S", help="Seconds, instead of the scenario's."),
    ] = None,
    vary: Annotated[
        Optional[list[str]],  # noqa: UP045
        typer.Option(metavar="KEY=LOW:HIGH", help="Draw a key of the scenario for each run; may be given more than once."),
    ] = None,
    workers: Annotated[Optional[int], typer.Option(metavar="N", help="Processes, instead of threads.")] = None,  # noqa: UP045
    scheduler: Annotated[Optional[str], typer.Option(metavar="ADDRESS", help="Dask scheduler, tcp://HOST:PORT.")] = None,  # noqa: UP045
    out: Out = None,
    resume: Annotated[bool, typer.Option("--resume", help="Go on with what the folder of --out holds.")] = False,
    no_figure: NoFigure = False,
    json: Json = False,
) -> Work:
    """Run a scenario many times (Monte Carlo); print the statistics of the errors beside their theoretical limit."""
    from insenv.cli.campaign import campaign as work

    return partial(
        work,
        scenario,
        estimator,
        runs=runs,
        seed=seed,
        duration_s=duration,
        vary=vary or [],
        workers=workers,
        scheduler=scheduler,
        out=out,
        resume=resume,
        figure=not no_figure,
        as_json=json,
    )
