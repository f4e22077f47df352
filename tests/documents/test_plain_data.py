"""Text that is not JSON or TOML within the limits is refused with a code."""

from __future__ import annotations

import ast
from collections.abc import Callable
from pathlib import Path
from typing import Annotated, Any, Literal

import pytest
from pydantic import Field, ValidationError, model_validator

from documents.plain_data import DEEPEST, MOST_DOTS, PlainDataCode, PlainDataError, parse_json, parse_toml
from documents.validation import NonNegative, Number, Positive, Section, Vector, Whole, describe_error
from tests.refusals import raises_refusal

ROOT = Path(__file__).parents[2]
FOLDERS = ("cuffstation", "station", "drivers", "recordings", "fitting", "solver", "documents")


@pytest.mark.parametrize(
    ("parse", "content", "code"),
    [
        (parse_json, "{", PlainDataCode.MALFORMED),
        (parse_json, "[NaN]", PlainDataCode.MALFORMED),
        (parse_json, b"\xff", PlainDataCode.NOT_TEXT),
        (parse_json, '["\\u0000"]', PlainDataCode.NOT_TEXT),
        (parse_json, '["\\ud800"]', PlainDataCode.NOT_TEXT),
        (parse_json, "[" * 9999 + "]" * 9999, PlainDataCode.TOO_DEEP),
        (parse_json, "[" * (DEEPEST + 1) + "]" * (DEEPEST + 1), PlainDataCode.TOO_DEEP),
        (parse_json, "1" * 5000, PlainDataCode.OUT_OF_RANGE),
        (parse_json, str(2**64), PlainDataCode.OUT_OF_RANGE),
        (parse_json, "1e999", PlainDataCode.OUT_OF_RANGE),
        (parse_toml, "a = ", PlainDataCode.MALFORMED),
        (parse_toml, "a = " + "1" * 5000, PlainDataCode.OUT_OF_RANGE),
        (parse_toml, "a = 2026-02-30", PlainDataCode.MALFORMED),
        (parse_toml, ".".join("a" * (MOST_DOTS + 2)) + " = 1", PlainDataCode.TOO_MANY_DOTS),
    ],
    ids=lambda value: str(value)[:12],
)
def test_a_text_beyond_the_limits_is_refused(
    parse: Callable[[str | bytes], Any], content: str | bytes, code: PlainDataCode
) -> None:
    with raises_refusal(code, kind=PlainDataError):
        parse(content)


def test_a_byte_order_mark_is_no_part_of_a_text_and_one_at_the_limits_is_read() -> None:
    """As PowerShell 5 and older editors on Windows write it; with CRLF."""
    assert parse_toml(b"\xef\xbb\xbf[daq]\r\na = 1\r\n") == {"daq": {"a": 1}}
    assert parse_json(b'\xef\xbb\xbf{"a":\r\n1}') == {"a": 1}
    assert parse_json(str(2**64 - 1)) == 2**64 - 1
    assert parse_json("[" * DEEPEST + "]" * DEEPEST) is not None
    assert parse_toml(".".join("a" * (MOST_DOTS // 4)) + " = 1")


# The sentence of a document that breaks its schema, and that no reader writes its own.


class Part(Section):
    count: Annotated[Whole, Field(ge=5, le=9)] = 5
    masses_kg: tuple[Positive, ...] = Field(default=(1.0,), min_length=1)


class Document(Section):
    rate: Literal["backward", "central"]
    value: Number = 0.0
    damping: NonNegative = 0.0
    place: Vector = (0.0, 0.0, 0.0)
    name: str = ""
    label: str | int = ""
    part: Part = Part()

    @model_validator(mode="after")
    def _has_no_devil(self) -> Document:
        if self.name == "devil":
            raise ValueError("name is 'devil',\nexpected another")
        return self


@pytest.mark.parametrize(
    ("change", "sentence"),
    [
        ({"speed": 1}, "unknown key speed"),
        ({"part": {"cuont": 5}}, "unknown key part.cuont"),
        ({"rate": "forward"}, "rate is 'forward', expected 'backward' or 'central'"),
        ({"value": "1"}, "value is '1', expected a number"),
        ({"value": True}, "value is True, expected a number"),
        ({"value": float("nan")}, "value is nan, expected a finite number"),
        ({"damping": -1}, "damping is -1, expected a number of at least 0"),
        ({"place": [1, 2]}, "place.2 is missing"),
        ({"place": 3}, "place is 3, expected a list"),
        ({"name": 3}, "name is 3, expected a text"),
        ({"name": "devil"}, "name is 'devil', expected another"),
        ({"label": [1]}, "label is [1], expected a text or a whole number"),
        ({"label": [1], "value": "x"}, "value is 'x', expected a number (and 2 more)"),
        ({"part": []}, "part is [], expected a table"),
        ({"part": {"count": 4}}, "part.count is 4, expected a number of at least 5"),
        ({"part": {"count": 10}}, "part.count is 10, expected a number of at most 9"),
        ({"part": {"count": 5.5}}, "part.count is 5.5, expected a whole number"),
        ({"part": {"masses_kg": [1, 0]}}, "part.masses_kg.1 is 0, expected a number above 0"),
        ({"value": "x", "damping": "x"}, "value is 'x', expected a number (and 1 more)"),
    ],
)
def test_the_first_fault_is_one_sentence_with_key_found_and_expected(change: dict[str, Any], sentence: str) -> None:
    with pytest.raises(ValidationError) as caught:
        Document.model_validate({"rate": "backward", **change})
    assert describe_error(caught.value) == sentence


def test_a_missing_key_is_named_below_its_context_and_a_long_value_cut() -> None:
    with pytest.raises(ValidationError) as caught:
        Document.model_validate({})
    assert describe_error(caught.value, context="suit") == "suit.rate is missing"
    with pytest.raises(ValidationError) as caught:
        Document.model_validate({"rate": "x" * 10_000})
    assert len(describe_error(caught.value)) < 400


def test_pydantic_s_errors_are_described_in_one_place() -> None:
    describing = {
        path.relative_to(ROOT).as_posix()
        for folder in FOLDERS
        for path in (ROOT / folder).rglob("*.py")
        if "msg" in (text := path.read_text(encoding="utf-8"))
        for node in ast.walk(ast.parse(text))
        if isinstance(node, ast.Subscript) and isinstance(node.slice, ast.Constant) and node.slice.value == "msg"
    }
    assert describing == {"documents/validation.py"}
