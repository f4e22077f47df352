"""An OpenSim file as elements with their lines, so that a refusal names element and line."""

from __future__ import annotations

import re
import xml.parsers.expat
from dataclasses import dataclass, field
from io import BytesIO
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from documents.regular_file import LARGEST_MODEL, read_regular
from solver.errors import SolverCode
from solver.model import ModelError

Array = NDArray[np.float64]
DEEPEST, MOST_ELEMENTS = 100, 500_000
MOST_FILES = 20
TRUE, FALSE = ("true", "1"), ("false", "0")

_COMMENT_OR_AMPERSAND = re.compile(rb"<!--(.*?)-->|&(?!#?\w+;)", re.DOTALL)
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

    def refusal(self, complaint: str, code: SolverCode = SolverCode.MALFORMED) -> ModelError:
        title = f"{self.tag} {self.name}".strip()
        return ModelError(f"{self.file.name}, line {self.line}: {title} {complaint}", code)

    def unsupported(self, kind: str, supported: str) -> ModelError:
        complaint = f"is a {kind} that the solver does not support; remove it, or replace it by one of {supported}"
        return self.refusal(complaint, SolverCode.UNSUPPORTED)

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

    def numbers(self, tag: str, count: int, default: str | None = None, *, may_be_infinite: bool = False) -> Array:
        found = self.find(tag)
        if found is None and default is None:
            raise self.refusal(f"has no <{tag}>")
        place, text = (found, found.text) if found is not None else (self, str(default))
        values = place.values(text)
        if len(values) != count:
            raise place.refusal(f"should hold {count} numbers, not {len(values)}")
        if not (may_be_infinite or np.isfinite(values).all()):
            raise place.refusal(f"should hold finite numbers, not '{text}'")
        return values

    def series(self, tag: str) -> Array:
        """All numbers of the element."""
        found = self.child(tag)
        values = found.values()
        if not np.isfinite(values).all():
            raise found.refusal("should hold finite numbers")
        return values

    def number(self, tag: str, default: str | None = None, *, may_be_infinite: bool = False) -> float:
        return float(self.numbers(tag, 1, default, may_be_infinite=may_be_infinite)[0])

    def positive(self, tag: str, default: str | None = None, *, above: float = 0.0) -> float:
        """A number above zero, or above another limit."""
        value = self.number(tag, default)
        if not value > above:
            sentence = f"should have <{tag}> above {above:g} and has {value:g}; correct it"
            raise self.refusal(sentence, SolverCode.NOT_POSITIVE)
        return value

    def not_negative(self, tag: str, default: str | None = None) -> float:
        value = self.number(tag, default)
        if value < 0.0:
            sentence = f"should have <{tag}> of 0 or above and has {value:g}; correct it"
            raise self.refusal(sentence, SolverCode.NOT_POSITIVE)
        return value

    def word(self, tag: str, default: str) -> str:
        found = self.find(tag)
        return found.text if found is not None else default

    def flag(self, tag: str, default: str = "false") -> bool:
        """A boolean property, as OpenSim reads it: True and 1 are true."""
        text = (self.word(tag, default) or default).lower()
        if text not in (*TRUE, *FALSE):
            raise self.refusal(f"should have true or false for <{tag}> and has '{text}'")
        return text in TRUE

    def is_off(self, *switches: str) -> bool:
        """Whether one of these boolean properties is false; they are true by default."""
        return not all(self.flag(switch, "true") for switch in switches)

    def require(self, tag: str, expected: str) -> None:
        """Refuse any value of an option but the one that the solver supports, which is also OpenSim's default."""
        found = self.find(tag)
        if found is not None and found.text != expected:
            complaint = f"has <{tag}> {found.text}; the solver supports only {expected}"
            raise self.refusal(complaint, SolverCode.UNSUPPORTED)

    def values(self, text: str | None = None) -> Array:
        """Numbers in a text, by default the element's own."""
        text = self.text if text is None else text
        try:
            values = np.array([float(word) for word in text.split()])
        except ValueError:
            raise self.refusal(f"should hold numbers, not '{text}'") from None
        if np.isnan(values).any():
            raise self.refusal(f"should hold numbers, not '{text}'")
        return values


def as_utf8(raw: bytes) -> bytes:
    """The file in its declared encoding, UTF-8, even if single bytes of it are Latin-1, without malformed comments.

    OpenSim writes and reads the names in <credits> byte for byte, whatever the header declares, and a comment ends at
    its first --> even if another begins within it. It also reads an & as itself, as between two authors.
    """
    declared = re.match(rb"<\?xml[^>]*encoding=[\"']([^\"']+)", raw)
    if raw.startswith(BYTE_ORDER_MARKS) or (declared and declared[1].lower() not in (b"utf-8", b"utf8")):
        return raw
    raw = _COMMENT_OR_AMPERSAND.sub(_well_formed, raw)
    try:
        raw.decode("utf-8")
    except UnicodeDecodeError:
        return raw.decode("latin-1").encode("utf-8")
    return raw


def _well_formed(found: re.Match[bytes]) -> bytes:
    """A comment, or as many line breaks if it holds what XML does not allow in one; an & as XML writes it."""
    if found[0] == b"&":
        return b"&amp;"
    is_malformed = b"--" in found[1] or found[1].endswith(b"-")
    return b"\n" * found[0].count(b"\n") if is_malformed else found[0]


def read_document(file: Path) -> Element:
    """The root element of an XML file, with the elements that it takes from other files. Raises ModelError.

    An element with an attribute `file`, such as <MeasurementSet file="measurements.xml"/>, is the element of the same
    tag in that file. As in OpenSim, paths start at the folder of the first document.
    """
    return _with_named_files(_parsed(file), file.parent, [])


def _with_named_files(element: Element, folder: Path, taken: list[str]) -> Element:
    """The element, itself and what it holds taken from the files they name, which `taken` lists."""
    named = element.attributes.get("file", "")
    if not named:
        for index, child in enumerate(element.children):
            element.children[index] = _with_named_files(child, folder, taken)
        return element
    taken.append(named)
    if len(taken) > MOST_FILES:
        complaint = (
            f"takes its content from {named}, after {MOST_FILES} other files; name fewer, and none within itself"
        )
        raise element.refusal(complaint)
    root = _parsed(folder / named)
    found = root if root.tag == element.tag else root.find(element.tag)
    if found is None:
        complaint = f"takes its content from {named}, which holds no {element.tag}; name a file that does"
        raise element.refusal(complaint, SolverCode.WRONG_DOCUMENT)
    return _with_named_files(found, folder, taken)


def _parsed(file: Path) -> Element:
    top = Element(file, 0, "", {})
    stack = [top]
    parser = xml.parsers.expat.ParserCreate()

    count = 0

    def start(tag: str, attributes: dict[str, str]) -> None:
        nonlocal count
        count += 1
        if len(stack) > DEEPEST or count > MOST_ELEMENTS:
            limits = f"more than {DEEPEST} nested elements, or more than {MOST_ELEMENTS} elements"
            sentence = f"{file.name}, line {parser.CurrentLineNumber}: has {limits}; give the file of a model"
            raise ModelError(sentence, SolverCode.UNREADABLE_FILE)
        element = Element(file, parser.CurrentLineNumber, tag, attributes)
        stack[-1].children.append(element)
        stack.append(element)

    def text(characters: str) -> None:
        stack[-1].pieces.append(characters)

    parser.StartElementHandler = start
    parser.EndElementHandler = lambda _tag: stack.pop()
    parser.CharacterDataHandler = text
    try:
        parser.ParseFile(BytesIO(as_utf8(read_regular(file, LARGEST_MODEL))))
    except OSError as error:
        sentence = f"cannot read {file}: {error.strerror}; check the path"
        raise ModelError(sentence, SolverCode.UNREADABLE_FILE) from error
    except xml.parsers.expat.ExpatError as error:
        complaint = xml.parsers.expat.ErrorString(error.code)
        sentence = f"{file.name} is not well-formed XML: {complaint} in line {error.lineno}"
        raise ModelError(sentence, SolverCode.UNREADABLE_FILE) from error
    return top.children[0]
