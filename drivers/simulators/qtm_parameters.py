"""QTM's settings as GetParameters gives them: general and 3D.

Does not imitate: the settings of every other component, and most of those two.
"""

from __future__ import annotations

from collections.abc import Sequence
from xml.sax.saxutils import escape

from drivers.simulators.settings import MocapSettings


def parameters_xml(wanted: Sequence[str], version: str, mocap: MocapSettings, labels: Sequence[str]) -> str | None:
    """The XML of the settings that are wanted ("general", "3d", "all"); None where none of them is known."""
    names = "".join(f"<Label><Name>{escape(name)}</Name><RGBColor>65280</RGBColor></Label>" for name in labels)
    cameras = "".join(
        f"<Camera><ID>{number}</ID><Serial>{serial}</Serial></Camera>"
        for number, serial in enumerate(mocap.camera_serials, 1)
    )
    blocks = {
        "general": f"<General><Frequency>{mocap.rate_hz:g}</Frequency>{cameras}</General>",
        "3d": f"<The_3D><AxisUpwards>+Z</AxisUpwards><CalibrationTime>{escape(mocap.calibrated)}</CalibrationTime>"
        f"<Labels>{len(labels)}</Labels>{names}</The_3D>",
    }
    chosen = "".join(block for name, block in blocks.items() if name in wanted or "all" in wanted)
    return f"<QTM_Parameters_Ver_{version}>{chosen}</QTM_Parameters_Ver_{version}>" if chosen else None
