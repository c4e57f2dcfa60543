"""Velocity from speed and course."""

import numpy as np
from text_logs import as_text, gnss_rows


def test_speed_and_course(folder):
    """Knots and degrees; no course at rest, no course under way; the vertical velocity is unknown."""
    lines = as_text(gnss_rows()).splitlines()
    motion = ["10,90", "0.2,", "8,nan"]
    text = "\n".join(["t,lat,lon,h,sn,se,sd,speed,course", *map(",".join, zip(lines, motion, strict=True))]) + "\n"
    folder.write("gnss.csv", text)
    folder.change(("[gnss]", '[gnss]\nspeed = "speed"\nspeed_unit = "kn"\ncourse = "course"\nspeed_sigma_mps = 0.1'))
    good, gnss = folder.toml, folder.load().gnss
    assert len(gnss.time) == 3
    np.testing.assert_allclose(gnss.velocity_n[0], [0.0, 18520 / 3600, 0.0], atol=1e-9)
    np.testing.assert_allclose(gnss.velocity_n[1:], 0.0)
    np.testing.assert_allclose(gnss.velocity_sigma[:, 0], [0.1, np.hypot(0.1, 0.2 * 1852 / 3600), 100.0])
    np.testing.assert_allclose(gnss.velocity_sigma[:, 2], 100.0)
    for old, said in (("speed_sigma_mps = 0.1", "speed needs either"), ('course = "course"\n', "speed and course go together")):
        folder.toml = good.replace(old, "")
        folder.error(said)
    folder.toml = good.replace('speed_unit = "kn"\n', "")
    folder.write("gnss.csv", text.replace("10,90", "-10,90"))
    folder.error("speed is -10, must be from 0 up")
