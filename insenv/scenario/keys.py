"""The table of a scenario's keys in docs/scenarios.md, and the schema in scenarios/schema.json.

``python -m insenv.scenario.keys`` in the repository renews both; tests compare.
"""

from __future__ import annotations

import json
from pathlib import Path

from pydantic import BaseModel

from insenv.files.toml import key_table, renew_page, renewed
from insenv.scenario import description
from insenv.scenario.files import json_schema
from insenv.sensors import GnssSection, ImuSection
from insenv.vehicles import aircraft_section as aircraft
from insenv.vehicles import car_section as car
from insenv.vehicles import section as legs
from insenv.vehicles import ship_section as ship

PAGE, SCHEMA = Path("docs/scenarios.md"), Path("scenarios/schema.json")
BEGIN, END = "<!-- keys: begin (python -m insenv.scenario.keys) -->", "<!-- keys: end -->"

_SECTIONS: tuple[tuple[str, type[BaseModel]], ...] = (
    ("top level", description.Scenario),
    ("[start]", legs.StartSection),
    ('[vehicle], kind = "ship"', ship.ShipSection),
    ("[vehicle.sway]", ship.SwaySection),
    ("a sinusoid of roll, pitch or yaw", ship.AngleWave),
    ("a sinusoid of north, east or down", ship.LengthWave),
    ("[vehicle.sea]", ship.SeaSection),
    ("[vehicle.sea.hull]", ship.HullSection),
    ("a leg of a ship", ship.ShipLeg),
    ('[vehicle], kind = "car"', car.CarSection),
    ("a frequency of an engine", legs.EngineWave),
    ("a leg of a car", car.CarLeg),
    ('[vehicle], kind = "aircraft"', aircraft.AircraftSection),
    ("a leg of an aircraft", aircraft.AircraftLeg),
    ("[imu]", ImuSection),
    ("[gnss]", GnssSection),
    ("[knowledge]", description.KnowledgeSection),
)
_PER_AXIS = "number or 3"
_SPECIAL = {
    "outages_s": "list of pairs",
    **dict.fromkeys(("gyro_bias_deg_h", "accel_bias_ug", "gust_velocity_sigma_mps", "wander_sigma_m"), _PER_AXIS),
    **dict.fromkeys(("position_noise_m", "velocity_noise_mps", "position_sigma_m", "velocity_sigma_mps"), _PER_AXIS),
}


def table() -> str:
    """Markdown: for each section its keys, values, units, defaults and meanings."""
    sections = [(title, _summary(model), model, list(model.model_fields)) for title, model in _SECTIONS]
    return key_table(sections, _SPECIAL, limits=True)


def _summary(model: type[BaseModel]) -> str:
    return (model.__doc__ or "").strip().partition("\n")[0]


def renew(text: str) -> str:
    """The text of the page with its table of keys replaced by the current one."""
    return renewed(text, BEGIN, END, table())


def schema_text() -> str:
    """What scenarios/schema.json should hold."""
    return json.dumps(json_schema(), indent=1, ensure_ascii=False) + "\n"


if __name__ == "__main__":
    renew_page(PAGE, renew)
    SCHEMA.write_text(schema_text(), encoding="utf-8")
