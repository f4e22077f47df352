"""JSON and TOML as plain data, within limits: what a hostile text would cost is refused in a sentence before it does.

Nested data are parsed by recursion, dotted keys of TOML at a cost that grows with the square of their parts, integers
of any length; none of the station's files is near these limits.
"""

from __future__ import annotations

import json
import math
import re
import tomllib
from pathlib import Path
from typing import Any, NoReturn

from documents.regular_file import read_regular

LARGEST_JSON, LARGEST_TOML = 16 * 2**20, 256 * 2**10  # bytes
DEEPEST = 100
LONGEST_QUOTE = 200
MOST_DOTS = 200
"""In a line of TOML, decimal points of lists aside."""


class PlainDataError(ValueError):
    """The text is not JSON or TOML within the limits. Says what it "is" or "holds"; its reader names the file."""

    exit_code = 1


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
        raise PlainDataError(f"is nested more than {DEEPEST} deep") from None
    except json.JSONDecodeError as error:
        raise PlainDataError(f"is not valid JSON: {error}") from error
    _ensure_plain(found, is_json=True)
    return found


def parse_toml(content: str | bytes) -> dict[str, Any]:
    """Every integer has at most 64 bits. Raises PlainDataError."""
    text = _text(content)
    if any(_NUMBER_IN_A_LIST.sub("", line).count(".") > MOST_DOTS for line in text.split("\n")):
        raise PlainDataError(f"has a line with more than {MOST_DOTS} dots")
    try:
        found = tomllib.loads(text)
    except RecursionError:
        raise PlainDataError(f"is nested more than {DEEPEST} deep") from None
    except tomllib.TOMLDecodeError as error:
        raise PlainDataError(f"is not valid TOML: {error}") from error
    except ValueError as error:  # an integer longer than Python reads, a date that is none
        raise PlainDataError("holds a number or a date out of range") from error
    _ensure_plain(found, is_json=False)
    return found


def shortened(found: object) -> str:
    """What was found in a file, as much of it as a sentence bears."""
    text = repr(found)
    return text if len(text) <= LONGEST_QUOTE else f"{text[:LONGEST_QUOTE]}…"


_NUMBER_IN_A_LIST = re.compile(r"(?<![\w.])\d+\.\d+(?=\s*[,\]}])")
_INT64_DIGITS = 20


def _text(content: str | bytes) -> str:
    try:
        return content if isinstance(content, str) else content.decode("utf-8")
    except UnicodeDecodeError as error:
        raise PlainDataError(f"is not UTF-8 at byte {error.start}") from error


def _integer(digits: str) -> int:
    if len(digits) > _INT64_DIGITS:
        raise PlainDataError(f"holds an integer of {len(digits)} digits, expected at most 64 bits")
    return int(digits)


def _refuse_constant(name: str) -> NoReturn:
    raise PlainDataError(f"holds {name}, which is no JSON; write null for a number that is not known")


def _ensure_plain(found: Any, *, is_json: bool) -> None:
    """Level by level, because recursion is what a deep nest would break."""
    level, depth = [found], 0
    while level:
        depth += 1
        if depth > DEEPEST:
            raise PlainDataError(f"is nested more than {DEEPEST} deep")
        below: list[Any] = []
        for value in level:
            if isinstance(value, dict):
                below += [*value, *value.values()]
            elif isinstance(value, list):
                below += value
            elif isinstance(value, int) and value.bit_length() > 64:
                raise PlainDataError("holds an integer of more than 64 bits")
            elif isinstance(value, float) and is_json and not math.isfinite(value):
                raise PlainDataError("holds a number beyond the range of a double")
            elif isinstance(value, str) and not _is_text(value):
                raise PlainDataError("holds NUL or half a character, expected text")
        level = below


def _is_text(value: str) -> bool:
    """Names of files that are not UTF-8 keep their bytes as Python's surrogates; no other halves are text."""
    if "\0" in value:
        return False
    try:
        value.encode("utf-8", "surrogateescape")
    except UnicodeEncodeError:
        return False
    return True
