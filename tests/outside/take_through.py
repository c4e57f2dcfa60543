"""Take the installed outside package through interfaces that other processes and tools use; print what each gave as JSON.

Run by test_outside.py: `python take_through.py FOLDER`.
"""

import json
import sys
from pathlib import Path

from places import ROOT

import insenv

RAIL = ROOT / "tests" / "outside" / "rail" / "rail.toml"


def main(folder: Path) -> dict:
    text = (ROOT / "examples" / "n380-car.toml").read_text()
    standing = folder / "standing.toml"  # an alignment in place is refused where the car drives
    text = text.replace("[imu]", "stop_s = 160.0\n\n[imu]", 1).replace("start_s = 150.0", "")
    standing.write_text(text.replace("from_s = 350.0", "from_s = 50.0"))
    found = {"replay": insenv.replay(standing, "ahrs").results[0].statistics()["rms"]["pitch_deg"]}
    given = {"duration_s": 20.0, "vary": {"compass.deviation_deg": (-1.0, 1.0)}}
    own, workers = (insenv.campaign(RAIL, "ahrs", 9, workers=count, **given).figures() for count in (None, 1))
    found |= {"campaign": own["heading_deg"]["rms"], "workers_agree": own == workers}
    for of, file in (("ahrs", "ahrs.fmu"), (RAIL, "rail.fmu")):
        found[file] = insenv.export_fmu(of, folder / file).stat().st_size
    return found


if __name__ == "__main__":  # worker processes import this file
    print(json.dumps(main(Path(sys.argv[1]))))
