"""insenv: a stepwise simulator, environments and estimators for strapdown inertial navigation.

This page is the contract of names, frames, units and conventions.  Every module keeps to it and does not
repeat it.

Frames
------
Right-handed and Cartesian.

==  ====================================================================================================
i   inertial: Earth-centred, not rotating; coincides with e at time 0
e   Earth-centred Earth-fixed (ECEF), WGS-84: z along the rotation axis, x through latitude 0, longitude 0
n   north, east, down (NED), at the vehicle, down along the ellipsoid's normal
w   wander azimuth: n turned about down by an angle that wanders, so that the poles are no special place
b   body: forward, right, down (FRD); the axes of the IMU after its mounting is applied
==  ====================================================================================================

Attitude
--------
`C_nb` and `q_nb` take components in b to components in n: ``v_n = C_nb @ v_b``.  Products chain by their
inner letters: ``C_eb = C_en @ C_nb``.  Quaternions are Hamilton's, scalar first, of unit norm: ``[w, x, y,
z]``.  Euler angles turn n into b by heading about down, then pitch about the new right axis, then roll
about the new forward axis (z-y-x).  Heading is clockwise from north, pitch is positive nose up, roll is
positive right side down.  A small attitude error is a rotation vector that says in its name the frame it is
resolved in.

Position and velocity
---------------------
Latitude and longitude are geodetic, in radians; height is above the ellipsoid, in metres, positive up.
`velocity_n` is the velocity relative to the Earth, resolved in n.  The last part of a name is the frame of
the components: `velocity_n`, `position_e`, `lever_arm_b`.  An angular rate carries three letters:
`omega_ie_n` is the rate of e relative to i, resolved in n.

Inertial samples
----------------
A sample holds increments over the interval that ends at its time: `delta_angle` (rad, the integral of the
body's rate relative to i) and `delta_velocity` (m/s, the integral of specific force), both in b.  Specific
force excludes gravity: at rest and level it is ``[0, 0, -g]``.  Rates and accelerations are derived by
dividing by the interval.

GNSS and time
-------------
Time is in seconds from the start of a run and never goes backwards.  A fix carries its time of validity,
which may be earlier than its arrival and lie between two inertial samples.

Units and numbers
-----------------
SI and radians everywhere inside; deg, deg/h, deg/sqrt(h), ug and ug/sqrt(Hz) only at the rim: scenario
files, printed tables, MAVLink.  A name there shows its unit: `bias_deg_h`, `duration_s`.  A plain name is
in SI.  All state is float64.  Vectors are columns of shape (n,); series have time along their first axis,
(samples, n).  Matrices are stored row by row.  Covariances are in the units of their states; a standard
deviation is one sigma.

Randomness
----------
Every random number is a pure function of (seed, stream, step): the same in every runner, on every machine.

Errors
------
What a caller can mend raises `insenv.base.errors.InputError` with the name, the value, the unit and what is
allowed; work that cannot be done raises `insenv.base.errors.InsenvError`.

Public names
------------
`run`, `replay` and `campaign` run estimators; `allan` measures an inertial unit, `budget` says which source of error
dominates, `tune` how to tune a filter; `load` reads a scenario; `page` writes a page that simulates in a browser;
`export_fmu` and `export_ssp` write FMUs, `export_c` a filter in C for a board; `fusion` composes a filter; `register`
adds an estimator, a vehicle or a sensor; `record` makes the log of a simulated drive, and `write` puts results and
logs into the formats of other tools.  `Report`, `Summary`, `Comparison`, `Budget` and `Tuning` are what runs,
campaigns, campaigns of several estimators, budgets and tuning give.  Each loads on first use: ``import insenv`` is
cheap.  It registers the environments with Gymnasium.  docs/api.md lists all public names.
"""

from __future__ import annotations

import sys as _sys

from insenv.base import starting as _starting

_starting.prepare()  # before anything that takes long to import

from typing import TYPE_CHECKING  # noqa: E402

from insenv.base.shipped import __version__ as __version__  # noqa: E402
from insenv.base.shipped import register as _register_environments  # noqa: E402

if TYPE_CHECKING:  # type checkers read only imports that are written out
    from insenv import testing as testing
    from insenv.base.errors import InputError as InputError
    from insenv.base.errors import InsenvError as InsenvError
    from insenv.core.model import Model as Model
    from insenv.core.model import Step as Step
    from insenv.core.tables import Row as Row
    from insenv.core.tables import Table as Table
    from insenv.envs import agents as agents
    from insenv.estimators import Estimator as Estimator
    from insenv.estimators import Knowledge as Knowledge
    from insenv.estimators.fusion import fusion as fusion
    from insenv.export import record as record
    from insenv.export import write as write
    from insenv.export.board import export_c as export_c
    from insenv.extending import register as register
    from insenv.fmu import export_fmu as export_fmu
    from insenv.fmu import export_ssp as export_ssp
    from insenv.report import Report as Report
    from insenv.runs.replayed import replay as replay
    from insenv.runs.simulated import run as run
    from insenv.scenario import Scenario as Scenario
    from insenv.scenario import limit as limit
    from insenv.scenario import load as load
    from insenv.sensors import Sensor as Sensor
    from insenv.sensors import SensorSection as SensorSection
    from insenv.sensors.instrument import Instrument as Instrument
    from insenv.studies.allan import allan as allan
    from insenv.studies.budget import budget as budget
    from insenv.studies.budget_result import Budget as Budget
    from insenv.studies.campaign import campaign as campaign
    from insenv.studies.campaign.comparison import Comparison as Comparison
    from insenv.studies.campaign.summary import Summary as Summary
    from insenv.studies.tune import tune as tune
    from insenv.studies.tune_result import Tuning as Tuning
    from insenv.vehicles import StartSection as StartSection
    from insenv.vehicles import Vehicle as Vehicle
    from insenv.vehicles import VehicleSection as VehicleSection
    from insenv.web.live import page as page

_HOMES = {
    "insenv.studies.campaign": ("campaign",),
    "insenv.studies.campaign.comparison": ("Comparison",),
    "insenv.studies.campaign.summary": ("Summary",),
    "insenv.core.model": ("Model", "Step"),
    "insenv.core.tables": ("Row", "Table"),
    "insenv": ("testing",),
    "insenv.export.board": ("export_c",),
    "insenv.envs": ("agents",),
    "insenv.base.errors": ("InputError", "InsenvError"),
    "insenv.estimators": ("Estimator", "Knowledge"),
    "insenv.estimators.fusion": ("fusion",),
    "insenv.export": ("record", "write"),
    "insenv.extending": ("register",),
    "insenv.fmu": ("export_fmu", "export_ssp"),
    "insenv.report": ("Report",),
    "insenv.runs.replayed": ("replay",),
    "insenv.runs.simulated": ("run",),
    "insenv.scenario": ("Scenario", "limit", "load"),
    "insenv.sensors": ("Sensor", "SensorSection"),
    "insenv.sensors.instrument": ("Instrument",),
    "insenv.vehicles": ("StartSection", "Vehicle", "VehicleSection"),
    "insenv.studies.allan": ("allan",),
    "insenv.studies.budget": ("budget",),
    "insenv.studies.budget_result": ("Budget",),
    "insenv.studies.tune": ("tune",),
    "insenv.studies.tune_result": ("Tuning",),
    "insenv.web.live": ("page",),
}
"""By module, the public names that it defines."""
_HOME = {name: home for home, names in _HOMES.items() for name in names}

__all__ = sorted(_HOME)

if not TYPE_CHECKING:

    def __getattr__(name: str) -> object:
        """A public name, or a submodule, imported on first use."""
        from importlib import import_module
        from importlib.util import find_spec

        if name in _HOME:
            home = import_module(_HOME[name])
            value = vars(home)[name] if name in vars(home) else import_module(f"{_HOME[name]}.{name}")
            globals()[name] = value
            return value
        if not name.startswith("_") and find_spec(f"{__name__}.{name}") is not None:
            return import_module(f"{__name__}.{name}")
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")

    def __dir__() -> list[str]:
        from pkgutil import iter_modules

        return sorted({*globals(), *__all__, *(m.name for m in iter_modules(__path__) if not m.name.startswith("_"))})


if not _starting.is_command(_sys.argv, _sys.orig_argv):  # which takes Gymnasium only for what needs it
    _register_environments()
