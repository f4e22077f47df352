"""JSON and TOML as plain data, within limits that bound the time and memory of parsing a hostile file.

Nesting is parsed by recursion, the cost of dotted keys in TOML grows with the square of their parts, and integers may
have any length. None of the station's files comes near the limits.
"""

from __future__ import annotations

import json
import math
import re
from enum import StrEnum
from pathlib import Path
from typing import Any, NoReturn

from documents.regular_file import read_regular

LARGEST_JSON, LARGEST_TOML = 16 * 2**20, 256 * 2**10  # bytes
DEEPEST = 100
LONGEST_QUOTE = 200
MOST_DOTS = 200
"""In a line of TOML, without the decimal points of lists."""
_NUMBER_IN_A_LIST = re.compile(r"(?<![\w.])\d+\.\d+(?=\s*[,\]}])")
_INT64_DIGITS = 20
_TOO_DEEP = f"is nested more than {DEEPEST} deep"


class PlainDataCode(StrEnum):
    """Stable codes of errors, for programs."""

    MALFORMED = "document.malformed"
    NOT_TEXT = "document.not_text"
    TOO_DEEP = "document.too_deep"
    TOO_MANY_DOTS = "document.too_many_dots"
    OUT_OF_RANGE = "document.out_of_range"


class PlainDataError(ValueError):
    """The text is not JSON or TOML within the limits. The sentence says what it "is" or "holds"; its reader adds the
    name of the file. code is for programs.
    """

    exit_code = 1

    def __init__(self, sentence: str, code: PlainDataCode = PlainDataCode.MALFORMED) -> None:
        super().__init__(sentence)
        self.code = code


def read_json(path: Path) -> Any:
    """A JSON file. Raises OSError where it cannot be read, PlainDataError for what is in it."""
    return parse_json(read_regular(path, LARGEST_JSON))


def read_toml(path: Path) -> dict[str, Any]:
    """A TOML file. Raises OSError where it cannot be read, PlainDataError for what is in it."""
    return parse_toml(read_regular(path, LARGEST_TOML))


def parse_json(content: str | bytes) -> Any:
    """Every number is finite and every integer has at most 64 bits. Raises PlainDataError."""
    try:
        found = json.loads(_text(content), parse_int=_integer, parse_constant=_refuse_constant)
    except RecursionError:
        raise PlainDataError(_TOO_DEEP, PlainDataCode.TOO_DEEP) from None
    except json.JSONDecodeError as error:
        raise PlainDataError(f"is not valid JSON: {error}") from error
    _ensure_plain(found, is_json=True)
    return found


def parse_toml(content: str | bytes) -> dict[str, Any]:
    """Every integer has at most 64 bits. Raises PlainDataError."""
    import tomllib

    text = _text(content)
    if any(_NUMBER_IN_A_LIST.sub("", line).count(".") > MOST_DOTS for line in text.split("\n")):
        raise PlainDataError(f"has a line with more than {MOST_DOTS} dots", PlainDataCode.TOO_MANY_DOTS)
    try:
        found = tomllib.loads(text)
    except RecursionError:
        raise PlainDataError(_TOO_DEEP, PlainDataCode.TOO_DEEP) from None
    except tomllib.TOMLDecodeError as error:
        raise PlainDataError(f"is not valid TOML: {error}") from error
    except ValueError as error:  # an integer longer than Python reads
        raise PlainDataError("holds a number out of range", PlainDataCode.OUT_OF_RANGE) from error
    _ensure_plain(found, is_json=False)
    return found


def finite_or_none(value: Any) -> Any:
    """The value with None in place of numbers that are not finite, which JSON does not have."""
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    if isinstance(value, dict):
        return {key: finite_or_none(one) for key, one in value.items()}
    return [finite_or_none(one) for one in value] if isinstance(value, list | tuple) else value


def shortened(found: object) -> str:
    """repr of a value of a file, cut to LONGEST_QUOTE characters."""
    text = repr(found)
    return text if len(text) <= LONGEST_QUOTE else f"{text[:LONGEST_QUOTE]}…"


def _text(content: str | bytes) -> str:
    """Without the byte order mark that editors and PowerShell on Windows write."""
    try:
        return content if isinstance(content, str) else content.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise PlainDataError(f"is not UTF-8 at byte {error.start}", PlainDataCode.NOT_TEXT) from error


def _integer(digits: str) -> int:
    if len(digits) > _INT64_DIGITS:
        sentence = f"holds an integer of {len(digits)} digits, expected at most 64 bits"
        raise PlainDataError(sentence, PlainDataCode.OUT_OF_RANGE)
    return int(digits)


def _refuse_constant(name: str) -> NoReturn:
    raise PlainDataError(f"holds {name}, which is not JSON; write null for an unknown number")


def _ensure_plain(found: Any, *, is_json: bool) -> None:
    """Raise PlainDataError for values beyond the limits. Level by level, because deep nesting would break recursion."""
    level, depth = [found], 0
    while level:
        depth += 1
        if depth > DEEPEST:
            raise PlainDataError(_TOO_DEEP, PlainDataCode.TOO_DEEP)
        below: list[Any] = []
        for value in level:
            if isinstance(value, dict):
                below += [*value, *value.values()]
            elif isinstance(value, list):
                below += value
            elif isinstance(value, int) and value.bit_length() > 64:
                raise PlainDataError("holds an integer of more than 64 bits", PlainDataCode.OUT_OF_RANGE)
            elif isinstance(value, float) and is_json and not math.isfinite(value):
                raise PlainDataError("holds a number beyond the range of a double", PlainDataCode.OUT_OF_RANGE)
            elif isinstance(value, str) and not _is_text(value):
                raise PlainDataError("holds NUL or half a character, expected text", PlainDataCode.NOT_TEXT)
        level = below


def _is_text(value: str) -> bool:
    """False for NUL and lone surrogates, except those by which Python keeps the bytes of a file name."""
    if "\0" in value:
        return False
    try:
        value.encode("utf-8", "surrogateescape")
    except UnicodeEncodeError:
        return False
    return True
