"""Windows of a log whose fixes are withheld: how they are written, and what of them is refused."""

from dataclasses import replace

import pytest
from places import ROOT

from insenv.base.errors import InputError
from insenv.logs import load
from insenv.logs.outages import listed, withheld

LOG = load(ROOT / "examples" / "logs" / "plain.toml")  # of 120 s, a fix each second
LATER = replace(LOG, imu_time=LOG.imu_time + 1.6e9, gnss=replace(LOG.gnss, time=LOG.gnss.time + 1.6e9))
EARLY = replace(LOG, gnss=replace(LOG.gnss, time=LOG.gnss.time - 0.5))


def test_windows_are_of_the_clock_of_the_log_or_of_the_start_or_regular():
    for outages in ("20:23", [(20.0, 23.0)], ["+10:+13"]):
        left, lost = withheld(LOG, listed(outages), 10.0)  # the begin belongs to the outage, as in a scenario
        assert (lost.windows.tolist(), lost.fixes.time.tolist(), *lost.resumed) == ([[20.0, 23.0]], [20.0, 21.0, 22.0], 23.0)
    assert withheld(LATER, ["+20:+30"], 1.6e9)[1].windows.tolist() == [[1600000020.0, 1600000030.0]]
    mixed = withheld(LOG, ["66:70", "every=50, length=10"], 5.0)[1].windows
    assert mixed.tolist() == [[55.0, 65.0], [66.0, 70.0], [105.0, 115.0]] and len(left.gnss.time) == 117
    assert withheld(LOG, ["every=50,length=20"], 5.0)[1].windows.tolist() == [[55.0, 75.0]]  # the next would pass the end
    assert withheld(withheld(LOG, ["30:40"], 0.0)[0], ["every=30,length=10"], 0.0)[1].empty == 1


@pytest.mark.parametrize(("outages", "words", "log"), [
    ([(20.0,)], "(20.0,): allowed are a begin and an end", LOG), (3.0, "list of these", LOG), ([7.0], "outage 7.0: ", LOG),
    ("0:120", "withhold every fix", EARLY), ("20:30", "the log has none", replace(LOG, gnss=None)),
    ("20:30", "1600000120 s on the clock of the log; +20:+30 c", LATER),
])  # fmt: skip
def test_what_is_no_outage_is_refused_in_one_sentence(outages, words, log):
    with pytest.raises(InputError) as caught:
        withheld(log, listed(outages), float(log.imu_time[0] - log.dt[0]))
    assert words in str(caught.value)
