"""An OpenSim model file as elements with their line, so that a refusal names element and line."""

from __future__ import annotations

import re
import xml.parsers.expat
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from documents.regular_file import LARGEST_MODEL, read_regular
from solver.model import ModelError

Array = NDArray[np.float64]
DEEPEST, MOST_ELEMENTS = 100, 500_000

BYTE_ORDER_MARKS = (b"\xff\xfe", b"\xfe\xff")  # of UTF-16


@dataclass(frozen=True)
class Element:
    """An XML element with its file and line, for refusals."""

    file: Path
    line: int
    tag: str
    attributes: dict[str, str]
    children: list[Element] = field(default_factory=list)
    pieces: list[str] = field(default_factory=list)

    @property
    def name(self) -> str:
        return self.attributes.get("name", "")

    @property
    def text(self) -> str:
        return "".join(self.pieces).strip()

    def refusal(self, complaint: str) -> ModelError:
        title = f"{self.tag} {self.name}".strip()
        return ModelError(f"{self.file.name}, line {self.line}: {title} {complaint}")

    def unsupported(self, kind: str, supported: str) -> ModelError:
        return self.refusal(f"is a {kind} the solver does not have; replace it ({supported}) or remove it")

    def find(self, tag: str) -> Element | None:
        return next((child for child in self.children if child.tag == tag), None)

    def child(self, tag: str) -> Element:
        found = self.find(tag)
        if found is None:
            raise self.refusal(f"has no <{tag}>")
        return found

    def members(self, tag: str) -> list[Element]:
        """Content of a list property; empty if absent."""
        found = self.find(tag)
        return found.children if found is not None else []

    def objects(self, tag: str) -> list[Element]:
        """Content of one of OpenSim's sets; empty if absent."""
        found = self.find(tag)
        return found.members("objects") if found is not None else []

    def numbers(self, tag: str, count: int, default: str | None = None) -> Array:
        found = self.find(tag)
        if found is None and default is None:
            raise self.refusal(f"has no <{tag}>")
        place, text = (found, found.text) if found is not None else (self, str(default))
        values = place._values(text)
        if len(values) != count:
            raise place.refusal(f"should hold {count} numbers, not {len(values)}")
        return values

    def series(self, tag: str) -> Array:
        """Numbers, as many as there are."""
        found = self.child(tag)
        return found._values(found.text)

    def number(self, tag: str, default: str | None = None) -> float:
        return float(self.numbers(tag, 1, default)[0])

    def word(self, tag: str, default: str) -> str:
        found = self.find(tag)
        return found.text if found is not None else default

    def require(self, tag: str, expected: str) -> None:
        """Refuses any other value of an option than the one the solver has, which is also OpenSim's default."""
        found = self.find(tag)
        if found is not None and found.text != expected:
            raise self.refusal(f"has <{tag}> {found.text}; the solver has only {expected}")

    def _values(self, text: str) -> Array:
        try:
            return np.array([float(word) for word in text.split()])
        except ValueError:
            raise self.refusal(f"should hold numbers, not '{text}'") from None


def as_utf8(raw: bytes) -> bytes:
    """The file in the encoding that it declares, UTF-8, also where single bytes of it are Latin-1.

    OpenSim writes and reads the names in <credits> byte for byte, whatever the header declares.
    """
    declared = re.match(rb"<\?xml[^>]*encoding=[\"']([^\"']+)", raw)
    if raw.startswith(BYTE_ORDER_MARKS) or (declared and declared[1].lower() not in (b"utf-8", b"utf8")):
        return raw
    try:
        raw.decode("utf-8")
    except UnicodeDecodeError:
        return raw.decode("latin-1").encode("utf-8")
    return raw


def read_document(file: Path) -> Element:
    """The root element of an XML file; ModelError where there is none."""
    top = Element(file, 0, "", {})
    stack = [top]
    parser = xml.parsers.expat.ParserCreate()

    count = 0

    def start(tag: str, attributes: dict[str, str]) -> None:
        nonlocal count
        count += 1
        if len(stack) > DEEPEST or count > MOST_ELEMENTS:
            limits = f"more than {DEEPEST} elements within each other, or more than {MOST_ELEMENTS}"
            raise ModelError(f"{file.name}, line {parser.CurrentLineNumber}: holds {limits}, as no model does")
        element = Element(file, parser.CurrentLineNumber, tag, attributes)
        stack[-1].children.append(element)
        stack.append(element)

    def text(characters: str) -> None:
        stack[-1].pieces.append(characters)

    parser.StartElementHandler = start
    parser.EndElementHandler = lambda _tag: stack.pop()
    parser.CharacterDataHandler = text
    try:
        parser.Parse(as_utf8(read_regular(file, LARGEST_MODEL)), True)
    except OSError as error:
        raise ModelError(f"cannot read {file}: {error.strerror}; check the path") from error
    except xml.parsers.expat.ExpatError as error:
        complaint = xml.parsers.expat.ErrorString(error.code)
        raise ModelError(f"{file.name} is not well-formed XML: {complaint} in line {error.lineno}") from error
    return top.children[0]
