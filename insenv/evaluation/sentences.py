"""Sentences about a run, with names in braces for what is filled in; a live page has them from here."""

from __future__ import annotations

CALLED = "{verdict}, factor {factor}"
SUMMARY = "{called}: {share} % of {count} {what} refused, {nis}"
WHOLE_AND_GNSS = "{called}; gnss: {own}"
NIS = "NIS {mean} ({low} to {high})"
NONE_USED = "none used"
UNTESTED = "untested: none of {count} {what} was compared with an estimate"
SMALLER = ", innovations smaller than stated"
WITHIN = " within {percent} % of sigma"

NO_FIX = "no fix came: the estimate is that of the inertial unit alone"
NO_FIX_BUT_AIDS = "no fix came: the estimate is that of the inertial unit and the other aids"

_FIXES = (
    "its innovations are {factor} times as large as stated, and it refused {refused} of {count} fixes. The errors may exceed "
    "the stated sigmas by more than that. Look at the grade of the inertial unit, the lever arm of the antenna, the time "
    "offset of the fixes, their stated sigmas and the start{or_aids}"
)
FIXES_DIVERGED = f"the filter has diverged from its fixes: {_FIXES}"
FIXES_OVERCONFIDENT = f"the filter is overconfident: {_FIXES}"
OR_AIDS = ", and at the other aids, which may be stated too surely: {aids}"
AID = (
    "{id} does not fit the filter ({verdict}): its innovations are {factor} times as large as stated, and {refused} of its "
    "{count} measurements were refused. The errors may exceed the stated sigmas"
)
CAUSES = ". Look at {causes}"
SLOW = (
    "positions scatter less than their sigmas say (mean NIS {mean}): their sigmas are too large, or part of their error is "
    "slow. A slow error does not average out: the position may then be wrong by the whole sigma of a fix, whatever the filter "
    "states"
)

TOO_SURE = "the errors are larger than this estimator states, rms over stated sigma: {ratios}"
STEEP = (
    "the pitch comes to {pitch} deg: errors of roll and heading are differences of Euler angles, which near 90 deg are large "
    "without an error of the attitude, and are not judged here"
)
STEEP_LIMIT = (
    "no limit of roll and heading: the pitch comes near 90 deg, where their errors are large without an error of the attitude"
)
