"""Units of length, as files of markers declare them."""

from __future__ import annotations

from recordings.errors import ForeignFile, RecordingCode

MILLIMETRES = {"mm": 1.0, "cm": 10.0, "m": 1000.0}
SPELLED_OUT = {
    "millimeter": "mm",
    "millimetre": "mm",
    "centimeter": "cm",
    "centimetre": "cm",
    "meter": "m",
    "metre": "m",
}

FEWEST_LETTERS = 4
"""Of a spelled unit; C3D cuts it to the width of its parameter."""


def millimetres(unit: str, where: str) -> float:
    """How many millimetres one of a file's units is; 1 where it names none, as mocap systems export in millimetres.

    Raises ForeignFile for an unknown unit.
    """
    told = unit.strip().lower().removesuffix("s") or "mm"
    cut = (short for spelled, short in SPELLED_OUT.items() if len(told) >= FEWEST_LETTERS and spelled.startswith(told))
    known = MILLIMETRES.get(next(cut, told))
    if known is None:
        raise ForeignFile(
            f"{where} has positions in {unit!r}, expected {', '.join(MILLIMETRES)}; export it in one of them, "
            "or import it with --mocap-unit",
            RecordingCode.FOREIGN_UNIT,
        )
    return known
