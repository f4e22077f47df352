"""A figure as the page carries it, inside itself."""

from __future__ import annotations

import base64
from dataclasses import dataclass


@dataclass(frozen=True)
class Picture:
    """A figure of the page: PNG as a data address, what it shows, and whether it takes the page's whole width."""

    address: str
    caption: str
    is_wide: bool = False


def picture(png: bytes, caption: str, is_wide: bool = False) -> Picture:
    return Picture("data:image/png;base64," + base64.b64encode(png).decode("ascii"), caption, is_wide)
