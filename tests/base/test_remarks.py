"""Remarks: a code and a text each, filled in without losing the code."""

import pickle
import re

import insenv
from insenv.base.remarks import TEXTS, Caveat, clock


def test_codes_are_kebab_case_and_stay_with_the_sentence():
    report = insenv.run("car-city-drive", "loosely-coupled", duration_s=2.0)
    assert report.results[0].notes and all(re.fullmatch(r"[a-z]+(-[a-z]+)*", code) for code in TEXTS)
    values = report.as_json()["results"][0]
    assert [each["text"] for each in values["remarks"]] == values["notes"] and values["remarks"][0]["code"] in TEXTS
    said = pickle.loads(pickle.dumps(Caveat("a-code", "{one:.2g} of {other}").filled(one=0.123)))
    assert said == "0.12 of {other}" and said.code == "a-code" and isinstance(said, Caveat)


def test_times_of_logs_that_count_from_a_date_are_printed_in_full():
    assert [clock(time) for time in (20.0, 12345.678, 1726480000.123456, 1726480001.0)] == [
        "20", "12345.7", "1726480000.123", "1726480001",
    ]  # fmt: skip
