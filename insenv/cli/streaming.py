"""The command `insenv stream`: its options; stream.py and lockstep.py do the work."""

from __future__ import annotations

from enum import Enum
from pathlib import Path
from typing import Annotated, Optional

import typer

from insenv.base.errors import InputError
from insenv.cli.options import Json, Scenario, Seed, command, given_path, one


class Lockstep(str, Enum):
    """The autopilot interface that `insenv stream --lockstep` serves."""

    px4 = "px4"
    ardupilot_json = "ardupilot-json"


@command
def stream(
    scenario: Scenario,
    to: Annotated[
        Optional[list[str]],  # noqa: UP045
        typer.Option(
            metavar="ADDRESS",
            help="udpout:HOST:PORT, udpin:..., tcpin:..., tcpout:... or serial:DEVICE:BAUD; without HOST only this machine."
            " May be given more than once: each address is one link.",
        ),
    ] = None,
    estimator: Annotated[
        Optional[list[str]],  # noqa: UP045
        typer.Option("--estimator", "-e", metavar="ID", help="Estimator to run; the default is the scenario's first."),
    ] = None,
    seed: Seed = None,
    speed: Annotated[
        Optional[float],  # noqa: UP045
        typer.Option(
            metavar="X", help="Simulated seconds per second, 1 by default; 0: as fast as possible, the default with ArduPilot."
        ),
    ] = None,
    duration: Annotated[
        Optional[float],  # noqa: UP045
        typer.Option(metavar="S", help="Simulated seconds; without it until Ctrl-C, with --speed 0 the scenario's duration."),
    ] = None,
    tlog: Annotated[
        Optional[Path],  # noqa: UP045
        typer.Option(parser=given_path, metavar="FILE", help="Write a telemetry log."),
    ] = None,
    rate: Annotated[
        Optional[list[str]],  # noqa: UP045
        typer.Option(metavar="MESSAGE=HZ", help="Rate of a message, 0 (none) to the rate of the samples; each message once."),
    ] = None,
    signing_key_file: Annotated[
        Optional[Path],  # noqa: UP045
        typer.Option(
            parser=given_path,
            metavar="FILE",
            help="Sign messages with the key in this file, and accept only messages signed with it.",
        ),
    ] = None,
    system: Annotated[
        int, typer.Option(metavar="N", help="MAVLink system of the vehicle, 1 to 255: several vehicles beside one another.")
    ] = 1,
    errors: Annotated[bool, typer.Option("--errors", help="Send the errors of the estimate too (NAMED_VALUE_FLOAT).")] = False,
    undulation: Annotated[
        float, typer.Option(metavar="M", help="Height of the geoid above the ellipsoid, the same everywhere.")
    ] = 0.0,
    lockstep: Annotated[
        Optional[Lockstep],  # noqa: UP045
        typer.Option(help="Advance sample by sample with an autopilot that connects (docs/lockstep.md)."),
    ] = None,
    score: Annotated[
        bool,
        typer.Option("--score", help="Judge the estimates that clients send: ODOMETRY, ATTITUDE and others (docs/score.md)."),
    ] = False,
    out: Annotated[
        Optional[Path],  # noqa: UP045
        typer.Option(
            "--out", "-o", parser=given_path, metavar="DIR", help="With --score: write the results, as of a run, there."
        ),
    ] = None,
    as_json: Json = False,
) -> None:
    """Stream the simulated vehicle and its estimate live over MAVLink to ground stations and other clients."""
    from insenv.cli import lockstep as in_step
    from insenv.cli import stream as live

    if lockstep is not None:
        if signing_key_file is not None:
            raise InputError("--lockstep allows no --signing-key-file: autopilots do not sign")
        for option, is_set in (
            ("--errors", errors),
            ("--system", system != 1),
            ("--undulation", undulation != 0.0),
            ("--score", score),
        ):
            if is_set:
                raise InputError(f"{option}: not allowed with --lockstep")
        if to and len(to) > 1:
            raise InputError(f"--to: {len(to)} addresses; --lockstep allows one, that of the autopilot")
        in_step.lockstep(
            scenario, one(estimator), kind=lockstep.value, to=to[0] if to else None, seed=seed, speed=speed,
            duration_s=duration, tlog=tlog, rates=rate or [], as_json=as_json,
        )  # fmt: skip
        return
    if out is not None and not score:
        raise InputError("--out: allowed with --score, whose results it takes")
    if not to:
        raise InputError("--to ADDRESS is missing, such as --to udpout:127.0.0.1:14550")
    live.stream(
        scenario, one(estimator), to=to, seed=seed, speed=1.0 if speed is None else speed, duration_s=duration, tlog=tlog,
        rates=rate or [], signing_key_file=signing_key_file, system=system, show_errors=errors, undulation=undulation,
        scored=score, out=out, as_json=as_json,
    )  # fmt: skip
