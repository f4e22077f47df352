"""Text that is not JSON or TOML within the limits is refused with a code."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import pytest

from documents.plain_data import DEEPEST, MOST_DOTS, PlainDataCode, PlainDataError, parse_json, parse_toml


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
def test_a_text_beyond_the_limits_is_refused_with_a_code(
    parse: Callable[[str | bytes], Any], content: str | bytes, code: PlainDataCode
) -> None:
    with pytest.raises(PlainDataError) as caught:
        parse(content)
    assert caught.value.code is code


def test_a_byte_order_mark_is_no_part_of_the_text() -> None:
    """As PowerShell 5 and older editors on Windows write it; with CRLF."""
    assert parse_toml(b"\xef\xbb\xbf[daq]\r\na = 1\r\n") == {"daq": {"a": 1}}
    assert parse_json(b'\xef\xbb\xbf{"a":\r\n1}') == {"a": 1}


def test_a_text_at_the_limits_is_read() -> None:
    assert parse_json(str(2**64 - 1)) == 2**64 - 1
    assert parse_json("[" * DEEPEST + "]" * DEEPEST) is not None
    assert parse_toml(".".join("a" * (MOST_DOTS // 4)) + " = 1")
