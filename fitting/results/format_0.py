"""What cuffs.json of format 0 says in sentences only: verdicts in the words of the stations that wrote it.

Format 0 has no "format". Its words are kept here as they were and never follow those of rendering.py.
"""

from __future__ import annotations

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


def verdicts_in(text: str) -> tuple[Verdict, ...]:
    """The verdicts that the text of a format-0 verdict holds."""
    return tuple(verdict for verdict, sentence in _VERDICTS.items() if sentence in text)
