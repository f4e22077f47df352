"""Read cuffs.json of format 0, which has no "format": written by hand, or with verdicts as sentences only.

The sentences of that format are kept here unchanged; those of sentences.py may be reworded.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from fitting.laws.model_class import KELVIN_VOIGT
from fitting.results.codes import Verdict
from recordings.manifest import DataOrigin

_WORN = (
    "stiffness_n_per_m",
    "damping_n_s_per_m",
    "migration_m",
    "not_identified",
    "verdict",
    "site",
    "donning",
    "law",
    "covariance",
    "notes",
    "diagnostics",
    "sources",
)
"""Keys of a cuff that are read; they have the same meaning in format 1."""
_TENSORS = ("stiffness_tensor_n_per_m", "damping_tensor_n_s_per_m")

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


def as_format_1(document: Mapping[str, Any]) -> dict[str, Any]:
    """A document of format 0 as format 1, reduced to the keys that are read. The schema checks the types."""
    return {"format": 1, "cuffs": {name: _cuff(entry) for name, entry in document["cuffs"].items()}}


def _cuff(entry: Any) -> Any:
    if not isinstance(entry, dict):
        return entry
    cuff = {key: entry[key] for key in _WORN if entry.get(key) is not None}
    text = entry.get("verdict")
    cuff["verdict_codes"] = [code for code, sentence in _VERDICTS.items() if isinstance(text, str) and sentence in text]
    if entry.get("origin") in list(DataOrigin):
        cuff["origin"] = entry["origin"]
    if chosen := _member(entry.get("model_class"), "chosen"):
        extensions = [name for name in str(chosen).split(" + ") if name != KELVIN_VOIGT]
        cuff["model_class"] = {"chosen": str(chosen), "extensions": extensions}
    for key in _TENSORS:
        if value := _member(entry.get(key), "value"):
            cuff[key] = {"value": value}
    return cuff


def _member(entry: Any, key: str) -> Any:
    """The value under a key, or the entry itself if it is not an object."""
    return entry.get(key) if isinstance(entry, dict) else entry
