"""Style of the figures that matplotlib draws outside the report (`station rmr --plot`, notebooks, docs), and PNG."""

from __future__ import annotations

import io
from typing import Any

import matplotlib as mpl
from matplotlib.figure import Figure
from PIL import Image

FORCE, MOTION, LINE, MARK = "#1f5f8b", "#c2571a", "#1b1b1b", "#8a8a8a"
SHADES = ("#1f5f8b", "#3f9c6b", "#b8860b", "#8b3a62", "#5a5a9a")
STYLE: dict[Any, Any] = {
    "font.size": 9,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "axes.axisbelow": True,
    "axes.titley": 1.0,  # else matplotlib measures every axis to find where a title is free of it
    "grid.color": "#e4e4e4",
    "legend.fontsize": 8,
    "legend.edgecolor": "none",
}
DPI = 120
COMPRESSION = 3
"""Level of zlib: 6, the usual one, takes almost twice the time for 2 % fewer bytes."""


def as_png(figure: Figure) -> bytes:
    """The same figure gives the same bytes: neither a date nor a version is in them."""
    pixels, png = io.BytesIO(), io.BytesIO()
    figure.set_dpi(DPI)
    with mpl.rc_context(STYLE):
        figure.savefig(pixels, format="rgba", dpi=DPI)
    opaque = Image.frombytes("RGBA", figure.canvas.get_width_height(), pixels.getvalue()).convert("RGB")
    opaque.save(png, "png", compress_level=COMPRESSION, dpi=(DPI, DPI))
    return png.getvalue()
