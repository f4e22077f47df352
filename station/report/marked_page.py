"""The numbers and figures that a page of the report marks with an id."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass
from html import unescape

from station.report.number_register import drawing_hash

NUMBER = re.compile(
    r'<(data|span) class="number" id="(?P<id>[^"]*)"(?: value="(?P<value>[^"]*)")? title="[^"]*">(?P<text>.*?)</\1>',
    re.DOTALL,
)
COMMAND = re.compile(r"</?code>")
"""Commands of a sentence; in a result they are in backticks."""
FIGURE = re.compile(
    r'<div id="(?P<id>figure\.[^"]*)">(?P<drawing>.*?)</div><!-- (?P=id) --><figcaption>(?P<caption>.*?)</figcaption>',
    re.DOTALL,
)


@dataclass(frozen=True)
class MarkedNumber:
    """Text of an element, and its attribute `value`, None for a sentence."""

    text: str
    value: str | None


@dataclass(frozen=True)
class MarkedFigure:
    """Caption of a figure and the SHA-256 of its drawing."""

    caption: str
    sha256: str


@dataclass(frozen=True)
class MarkedPage:
    """Numbers and figures by id."""

    numbers: Mapping[str, MarkedNumber]
    figures: Mapping[str, MarkedFigure]


def read_marks(page: str) -> MarkedPage:
    """The marks on a page as written by the register of numbers."""
    return MarkedPage(
        {
            unescape(found["id"]): MarkedNumber(
                unescape(COMMAND.sub("`", found["text"])), None if found["value"] is None else unescape(found["value"])
            )
            for found in NUMBER.finditer(page)
        },
        {
            unescape(found["id"]): MarkedFigure(unescape(found["caption"]), drawing_hash(found["drawing"]))
            for found in FIGURE.finditer(page)
        },
    )
