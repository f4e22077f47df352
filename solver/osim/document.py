"""An OpenSim file as elements with their lines, so that a refusal names element and line."""

from __future__ import annotations

import codecs
import os
import re
import xml.parsers.expat
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from documents.regular_file import LARGEST_MODEL, read_regular
from solver.errors import SolverCode
from solver.model import Array, ModelError

DEEPEST, MOST_ELEMENTS = 100, 500_000
MOST_FILES = 20
MOST_QUOTED = 40
TRUE, FALSE = ("true", "1"), ("false", "0")
SWITCHES = {"apply": "false", "appliesForce": "false", "isDisabled": "true"}
"""Properties, and the value by which an element is not used."""
DRAWN = dict.fromkeys(("Appearance", "VisibleObject", "default_color"), ".*")
"""Elements of markers and forces that change only their pictures, for Element.unused."""

BYTE_ORDER_MARKS = {
    codecs.BOM_UTF32_LE: "utf-32",
    codecs.BOM_UTF32_BE: "utf-32",
    codecs.BOM_UTF16_LE: "utf-16",
    codecs.BOM_UTF16_BE: "utf-16",
    "<".encode("utf-32-le"): "utf-32-le",
    "<".encode("utf-32-be"): "utf-32-be",
    "<".encode("utf-16-le"): "utf-16-le",
    "<".encode("utf-16-be"): "utf-16-be",
}
"""With which a file in these encodings begins; the mark may be missing."""
_DECLARATION = re.compile(rb"(\s*<\?xml[^>]{0,200}?encoding\s*=\s*[\"'])([^\"'<>]+)")
_AMPERSAND = re.compile(rb"&(?!#?\w{1,40};)")
_NO_CHARACTER_SETS = ("", "idna", "punycode", "raw_unicode_escape", "undefined", "unicode_escape")
"""Codecs of Python that are not encodings of a file."""


@dataclass(frozen=True)
class Element:
    """An XML element with its file and line, for refusals, the tags of its children that were looked for, and the files
    that it names and that were found elsewhere.
    """

    file: Path
    line: int
    tag: str
    attributes: dict[str, str]
    children: list[Element] = field(default_factory=list)
    pieces: list[str] = field(default_factory=list)
    sought: set[str] = field(default_factory=set)
    moved: set[str] = field(default_factory=set)

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
        self.sought.add(tag)
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

    def own(self, tag: str) -> Element | None:
        """The element of the tag, which is the root of the document, or below OpenSimDocument."""
        return self if self.tag == tag else self.find(tag)

    def named_file(self, tag: str) -> Path | None:
        """The file that a property names; None without one. Paths start at the folder of the document.

        OpenSim on Windows writes backslashes and reads names in capitals and small letters alike. A file that is not
        there is taken from the folder of the document, if it is there: it was copied from another computer.
        """
        text = self.word(tag, "")
        if not text or text == "Unassigned":
            return None
        named = self.file.parent / text.replace("\\", "/")
        if os.path.exists(named):  # noqa: PTH110  (False also for a name that is too long)
            return named
        alike = [file for file in self.file.parent.iterdir() if file.name.lower() == named.name.lower()]
        if not alike:
            return named
        beside = min(alike, key=lambda file: (file.name != named.name, file.name))
        self.moved.add(f"{text} as {beside.name}")
        return beside

    def line_naming(self, file: Path) -> int:
        """Line of the first element whose text is the name of the file, with or without folders; 0 without one."""
        if self.text.replace("\\", "/").rpartition("/")[2] == file.name:
            return self.line
        return next((line for child in self.children if (line := child.line_naming(file))), 0)

    def moved_files(self) -> list[str]:
        """`name as name beside` for the files below the element that named_file has found in the document's folder."""
        return [*sorted(self.moved), *(file for child in self.children for file in child.moved_files())]

    def unused(self, without_effect: Mapping[str, str]) -> list[str]:
        """`<tag> text (line N)` for what was not looked for, and what repeats an element above: the first counts.

        without_effect: tag → pattern of the texts that change no result. What is switched off is not in it.
        """
        found, above = [], set[str]()
        for child in self.children:
            is_repeated = self.tag != "objects" and child.tag in above
            above.add(child.tag)
            pattern = without_effect.get(child.tag)
            has_effect = pattern is None or not re.fullmatch(pattern, child.text, re.IGNORECASE)
            is_empty = not child.children and child.text in ("", "Unassigned")
            if child.tag == "groups" or is_empty or not has_effect or child._is_switched_off():
                continue
            if not is_repeated and (child.tag in self.sought or (self.tag == "objects" and child.sought)):
                found += child.unused(without_effect)
            else:
                name = f" {child.name}" * bool(child.name)
                found.append(f"<{child.tag}>{name} {child.text[:MOST_QUOTED]}".rstrip() + f" (line {child.line})")
        return found

    def _is_switched_off(self) -> bool:
        """By a switch that the reader obeyed, or that is in an element of which it read nothing."""
        return any(
            child.text.lower() == SWITCHES.get(child.tag) and (child.tag in self.sought or not self.sought)
            for child in self.children
        )

    def objects(self, tag: str) -> list[Element]:
        """Content of one of OpenSim's sets; empty if absent."""
        found = self.find(tag)
        return found.members("objects") if found is not None else []

    def numbers(self, tag: str, count: int, default: str | None = None, *, may_be_infinite: bool = False) -> Array:
        found = self.find(tag)
        if found is None and default is None:
            raise self.refusal(f"has no <{tag}>")
        is_given = found is not None and (found.text or default is None)
        place, text = (found, found.text) if found is not None and is_given else (self, str(default))
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

    def values(self, text: str | None = None) -> Array:
        """Numbers in a text, by default the element's own."""
        text = self.text if text is None else text
        try:
            values = np.array([float(word.replace("_", "?")) for word in text.split()])  # float() accepts 1_000
        except ValueError:
            raise self.refusal(f"should hold numbers, not '{text}'") from None
        if np.isnan(values).any():
            raise self.refusal(f"should hold numbers, not '{text}'")
        return values


def as_utf8(raw: bytes) -> bytes:
    """The file in UTF-8, without malformed comments.

    OpenSim writes and reads names byte for byte, whatever encoding the header declares. So a file that is not in that
    encoding, or in one that is not known, is in UTF-8, or else in Latin-1. A comment ends at its first --> even if
    another begins within it. OpenSim also reads an & as itself, as between two authors.
    """
    declared = _DECLARATION.match(raw)
    marked = next((name for mark, name in BYTE_ORDER_MARKS.items() if raw.startswith(mark)), "")
    names = [marked] if marked else [declared[2].decode("latin-1") if declared else "", "utf-8", "latin-1"]
    text = next((found for found in (_decoded(raw, name) for name in names) if found is not None), None)
    if text is None:
        return raw
    raw = text.encode("utf-8")
    if declared := _DECLARATION.match(raw):
        raw = declared[1] + b"UTF-8" + raw[declared.end() :]
    return _well_formed(raw)


def _decoded(raw: bytes, name: str) -> str | None:
    """None where the bytes are not XML in the encoding of the name."""
    if name.lower().replace("-", "_") in _NO_CHARACTER_SETS:
        return None
    try:
        text = raw.decode(name)
    except (LookupError, ValueError):  # not known, not of text, or not these bytes
        return None
    return text.removeprefix("\ufeff") if "<" in text and "\0" not in text else None


def _well_formed(raw: bytes) -> bytes:
    """A comment becomes as many line breaks if it holds what XML does not allow in one; an & is as XML writes it."""
    pieces, at = [], 0
    while (begin := raw.find(b"<!--", at)) >= 0 and (close := raw.find(b"-->", begin + 4)) >= 0:
        content = raw[begin + 4 : close]
        is_malformed = b"--" in content or content.endswith(b"-")
        pieces += [
            _AMPERSAND.sub(b"&amp;", raw[at:begin]),
            b"\n" * content.count(b"\n") if is_malformed else raw[begin : close + 3],
        ]
        at = close + 3
    return b"".join([*pieces, _AMPERSAND.sub(b"&amp;", raw[at:])])


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
    path = folder / named.replace("\\", "/")
    if not os.path.exists(path):  # noqa: PTH110  (as above)
        complaint = f"takes its content from {named}, which is not there; correct the path"
        raise element.refusal(complaint, SolverCode.UNREADABLE_FILE)
    root = _parsed(path)
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
        parser.Parse(as_utf8(read_regular(file, LARGEST_MODEL)), True)  # noqa: FBT003  (in pieces, a long attribute is read again)
    except OSError as error:
        sentence = f"cannot read {file}: {error.strerror}; check the path"
        raise ModelError(sentence, SolverCode.UNREADABLE_FILE) from error
    except xml.parsers.expat.ExpatError as error:
        complaint = xml.parsers.expat.ErrorString(error.code)
        sentence = f"{file.name} is not well-formed XML: {complaint} in line {error.lineno}"
        raise ModelError(sentence, SolverCode.UNREADABLE_FILE) from error
    return top.children[0]
