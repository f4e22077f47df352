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


def millimetres(unit: str, where: str) -> float:
    """How many millimetres one of a file's units is; 1 where it names none, as mocap systems export in millimetres.

    Raises ForeignFile for an unknown unit.
    """
    told = unit.strip().lower() or "mm"
    known = MILLIMETRES.get(SPELLED_OUT.get(told.removesuffix("s"), told))
    if known is None:
        raise ForeignFile(
            f"{where} has positions in {unit!r}, expected {', '.join(MILLIMETRES)}; export it in one of them, "
            "or import it with --mocap-unit",
            RecordingCode.FOREIGN_UNIT,
        )
    return known
