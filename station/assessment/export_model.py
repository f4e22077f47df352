"""Suit and cuffs → SUITED.osim, a model in which users of OpenSim find the suit worn."""

from __future__ import annotations

import xml.etree.ElementTree as Xml
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from solver.osim.document import as_utf8
from solver.osim.suited import add_suit
from solver.osim.writer import osim_document
from solver.suit.scenarios import Condition, SuitScenario
from solver.suit.suit import BUNDLED_SUIT, read_suit
from station.assessment.assessment_inputs import InputError, UnknownCuff, cuff_remarks, read_cuffs_to_wear, worn_cuffs
from station.assessment.sources import BUNDLED, model_of
from station.whole_file import write_whole


@dataclass(frozen=True)
class SuitToExport:
    """What is worn by which model; without a cuffs.json both cuffs are rigid, rest_length [m] None is the suit's."""

    model: str = "bundled"
    suit: Path = BUNDLED_SUIT
    cuffs: Path | None = None
    cuff: str | None = None
    condition: Condition | None = None
    rest_length: float | None = None


def write_suited_model(worn: SuitToExport, output: Path) -> list[str]:
    """Write the .osim; a user's own model keeps all it has. Returns remarks on the cuffs, which the file holds, too.

    Raises as the readers do, and where they do not fit.
    """
    suit = read_suit(worn.suit)
    if worn.rest_length is not None:
        suit = replace(suit, reference_rest_length=worn.rest_length)
    model = model_of(worn.model)
    root = osim_document(model) if worn.model == BUNDLED else _document(Path(worn.model))
    wearing, remarks = _wearing(worn, suit.reference_rest_length)
    add_suit(root, model, suit, wearing)
    for remark in reversed(remarks):
        root.insert(0, Xml.Comment(f" {remark.replace('--', '-')} "))
    Xml.indent(root, "\t")
    write_whole(output, '<?xml version="1.0" encoding="UTF-8"?>\n' + Xml.tostring(root, encoding="unicode") + "\n")
    return remarks


def _wearing(worn: SuitToExport, rest_length: float) -> tuple[SuitScenario, list[str]]:
    lengths = np.array([rest_length])
    if worn.cuffs is None:
        if worn.cuff is not None:
            raise UnknownCuff(f"the cuff {worn.cuff} needs a cuffs.json that holds it; name one by --cuffs")
        if worn.condition not in (None, "rigid"):
            raise InputError(f"the condition {worn.condition} needs cuffs, and none are given; name a cuffs.json")
        return SuitScenario("rigid", None, None, lengths), []
    chosen = (worn.cuff,) if worn.cuff else ()
    fits = read_cuffs_to_wear(worn.cuffs, chosen)
    cuffs = worn_cuffs(fits, chosen)
    arms, waists = ([cuff for cuff in cuffs if cuff.site == site] for site in ("arm", "waist"))
    if len(arms) != 1 or len(waists) > 1:
        names = ", ".join(cuff.name for cuff in arms) or "none"
        raise InputError(f"a suited model wears one arm cuff and there are {names}; choose one by --cuff")
    remarks = cuff_remarks(worn.cuffs, (fits[cuff.name] for cuff in cuffs))
    return SuitScenario(worn.condition or "both", waists[0] if waists else None, arms[0], lengths), remarks


def _document(path: Path) -> Xml.Element:
    """The file's root with the comments of its author."""
    builder = Xml.TreeBuilder(insert_comments=True)
    return Xml.fromstring(as_utf8(path.read_bytes()), Xml.XMLParser(target=builder))  # noqa: S314  (read_osim has read it)
