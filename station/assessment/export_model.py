"""Export suit and cuffs as an .osim model with the suit, for OpenSim."""

from __future__ import annotations

import xml.etree.ElementTree as Xml
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from documents.message import Message
from solver.osim.document import as_utf8
from solver.osim.model_writer import osim_document
from solver.osim.suited import add_suit
from solver.suit.cord import Condition, SuitScenario
from solver.suit.suit import BUNDLED_SUIT, read_suit
from station.assessment.assessment_inputs import WrongOptions, cuff_remarks, one_arm_cuff, read_cuffs_to_wear
from station.checksums import write_whole
from station.messages.assessment_messages import InputCode
from station.sources import BUNDLED, resolve_model


@dataclass(frozen=True)
class SuitToExport:
    """Model, suit and cuffs; without a cuffs.json both cuffs are rigid, rest_length [m] None is that of the suit."""

    model: str = "bundled"
    suit: Path = BUNDLED_SUIT
    cuffs: Path | None = None
    cuff: str | None = None
    condition: Condition | None = None
    rest_length: float | None = None


def write_suited_model(worn: SuitToExport, output: Path) -> list[str]:
    """Write the .osim; a model from a file keeps all its content. Returns remarks on the cuffs, which are in the file.

    Raises the errors of the readers, and InputError if the files do not fit together.
    """
    suit = read_suit(worn.suit)
    if worn.rest_length is not None:
        suit = replace(suit, reference_rest_length=worn.rest_length)
    model = resolve_model(worn.model)
    root = osim_document(model) if worn.model == BUNDLED else _document(Path(worn.model))
    scenario, remarks = _scenario(worn, suit.reference_rest_length)
    add_suit(root, model, suit, scenario)
    for remark in reversed(remarks):
        root.insert(0, Xml.Comment(f" {remark.replace('--', '-')} "))
    Xml.indent(root, "\t")
    write_whole(output, '<?xml version="1.0" encoding="UTF-8"?>\n' + Xml.tostring(root, encoding="unicode") + "\n")
    return remarks


def _scenario(worn: SuitToExport, rest_length: float) -> tuple[SuitScenario, list[str]]:
    lengths = np.array([rest_length])
    if worn.cuffs is None:
        if worn.cuff is not None:
            raise WrongOptions(Message(InputCode.NO_CUFFS_FILE, {"cuff": worn.cuff}))
        if worn.condition not in (None, "rigid"):
            raise WrongOptions(Message(InputCode.CONDITION_WITHOUT_CUFFS, {"condition": str(worn.condition)}))
        return SuitScenario("rigid", None, None, lengths), []
    chosen = (worn.cuff,) if worn.cuff else ()
    fits = read_cuffs_to_wear(worn.cuffs, chosen)
    waist, arm = one_arm_cuff(fits, chosen)
    remarks = cuff_remarks(worn.cuffs, (fits[cuff.name] for cuff in (waist, arm) if cuff))
    return SuitScenario(worn.condition or "both", waist, arm, lengths), remarks


def _document(path: Path) -> Xml.Element:
    """The root element of the file, including comments."""
    builder = Xml.TreeBuilder(insert_comments=True)
    return Xml.fromstring(as_utf8(path.read_bytes()), Xml.XMLParser(target=builder))  # noqa: S314  (read_osim has read it)
