"""The sentences of what a fit says, rendered last and here alone; programs go by the codes."""

from __future__ import annotations

from collections.abc import Iterable

from fitting.results.codes import Verdict

_VERDICTS = {
    Verdict.IDENTIFIED: "stiffness, damping and migration are identified",
    Verdict.GIVEN: "the figures are given, not fitted",
    Verdict.NO_STATIC: (
        "stiffness and migration are not identified: there is no usable static trial; record --test static"
    ),
    Verdict.FEW_LOADS: "stiffness is not identified: fewer than three loads were held; hold each for at least 4 s",
    Verdict.ONLY_ROSE: (
        "stiffness is not identified: the load only rose, not along a line, so the cuff may have slipped; "
        "take the weights off before the capture ends"
    ),
    Verdict.STIFFNESS_UNCERTAIN: (
        "stiffness is not identified: its interval is wider than its value; hang more weight on"
    ),
    Verdict.NO_DYNAMIC: "damping is not identified: there is no usable dynamic trial; record --test dynamic",
    Verdict.LAG: (
        "damping is not identified: what is not known of the lag between force and markers, times the stiffness, "
        "leaves too much of it open; record --test bounce, raise daq.sample_rate_hz or start by PFI0"
    ),
    Verdict.DAMPING_UNCERTAIN: "damping is not identified: noise leaves too much of it open; pull faster and farther",
    Verdict.NEGATIVE: (
        "damping is not identified: it comes out negative, and a cuff takes energy; force and markers are not at the "
        "times that are taken for theirs, record --test bounce"
    ),
    Verdict.SCALE: (
        "stiffness and damping are not identified: the load cell reads another force than the protocol's weights "
        "exert; correct load_cell or protocol.step_masses_kg, and fit again"
    ),
    Verdict.SKIN: (
        "stiffness and damping are not identified: the anchor's markers deform with the load, and the cuff's way is "
        "measured against them; fix them to bone or to a plate, and record again"
    ),
    Verdict.NOT_UNLOADED: (
        "migration is not identified: the first static trial does not start, or the last does not end, unloaded"
    ),
    Verdict.MIGRATED_BEFORE: (
        "migration is not identified: an earlier static recording of this donning cannot be used, and the cuff may "
        "have migrated in it; don the cuff anew and record again"
    ),
}


def verdict_sentence(verdict: Verdict) -> str:
    """One verdict as a clause, with what to do about it."""
    return _VERDICTS[verdict]


def verdict_text(verdicts: Iterable[Verdict]) -> str:
    """All verdicts as one text."""
    return "; ".join(map(verdict_sentence, verdicts))
