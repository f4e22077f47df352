"""Validate documents with pydantic, and turn the first of its errors into one sentence."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Annotated, Any

from pydantic import BaseModel, ConfigDict, Field, Strict, StrictInt, ValidationError

from documents.message import Code, Figures, Message, because
from documents.plain_data import PlainDataError, shortened

Number = Annotated[float, Strict(), Field(allow_inf_nan=False)]
"""A finite number; texts and Booleans are refused."""
Positive = Annotated[Number, Field(gt=0)]
NonNegative = Annotated[Number, Field(ge=0)]
Whole = StrictInt
Vector = tuple[Number, Number, Number]
_TYPES = {"str", "int", "float", "bool"}
UNKNOWN_KEY = ("extra_forbidden", "unexpected_keyword_argument")
"""Types of pydantic's error for a key that a model, or a dataclass, does not have."""
_EXPECTED = {
    "model_type": "a table",
    "dataclass_type": "a table",
    "dict_type": "a table",
    "tuple_type": "a list",
    "list_type": "a list",
    "float_type": "a number",
    "int_type": "a whole number",
    "string_type": "a text",
    "greater_than": "a number above {gt:g}",
    "greater_than_equal": "a number of at least {ge:g}",
    "less_than": "a number below {lt:g}",
    "less_than_equal": "a number of at most {le:g}",
    "too_short": "a list of {min_length} or more",
    "too_long": "a list of at most {max_length}",
}
"""Type of pydantic's error → expectation in terms of TOML."""


class Section(BaseModel):
    """A table of a document; unknown keys are refused."""

    model_config = ConfigDict(extra="forbid", frozen=True)


class FiniteSection(Section):
    """A table whose numbers are finite."""

    model_config = ConfigDict(allow_inf_nan=False)


DOCUMENT_ERRORS = (OSError, PlainDataError, ValidationError)
"""Of a document that cannot be read, parsed or validated."""


def invalid_because(error: Exception) -> Figures:
    """Figures of the cause of a message: why a document cannot be used, one of DOCUMENT_ERRORS, without its path."""
    return {"reason": describe_error(error)} if isinstance(error, ValidationError) else because(error)


@contextmanager
def refused_as(
    refusal: Callable[[Message[Any]], Exception], path: Path, unreadable: Code, invalid: Code | None = None
) -> Iterator[None]:
    """Convert errors of reading, parsing and validating the document at `path` to a refusal with its path and reason.

    The code is `unreadable`, and for a document that was parsed `invalid` where it is given.
    """
    try:
        yield
    except DOCUMENT_ERRORS as error:
        code = invalid if invalid is not None and isinstance(error, ValidationError) else unreadable
        raise refusal(Message(code, {"path": str(path), **invalid_because(error)})) from error


def describe_error(error: ValidationError, *, context: str = "") -> str:
    """One sentence for the first error: key below `context`, value found, value expected; then the number of others."""
    first, *more = error.errors()
    key = faulty_key(error, context=context)
    if first["type"] in UNKNOWN_KEY:
        sentence = f"unknown key {key}"
    elif first["type"] == "value_error":
        sentence = f"{key}: {first['ctx']['error']}" if key else str(first["ctx"]["error"])
    elif first["type"] == "missing":
        unknown = next((other for other in more if _is_beside(other, first)), None)
        sentence = f"{key} is missing"
        if unknown is not None:  # misspelt, or under an older name
            more.remove(unknown)
            sentence += f", and {unknown['loc'][-1]} is not known"
    else:
        same = [error for error in more if _is_alternative(error, first)]
        more = [error for error in more if error not in same]
        expected = " or ".join([_expected(first), *(_expected(error).removeprefix("expected ") for error in same)])
        sentence = f"{key} is {shortened(first['input'])}, {expected}" if key else expected
    return " ".join(sentence.split()) + (f" (and {len(more)} more)" if more else "")


def _is_beside(error: Mapping[str, Any], missing: Mapping[str, Any]) -> bool:
    """Whether it is an unknown key in the table that lacks one."""
    return bool(error["type"] in UNKNOWN_KEY and error["loc"][:-1] == missing["loc"][:-1])


def _is_alternative(error: Mapping[str, Any], first: Mapping[str, Any]) -> bool:
    """Whether it is the error of another type of the same value, as of a text or a whole number."""
    return bool(error["loc"] != _place(error) == _place(first) != first["loc"])


def faulty_key(error: ValidationError, *, context: str = "") -> str:
    """The key of the first fault below `context`, with dots: `cuffs.hand.site`."""
    return ".".join([context] * bool(context) + [str(part) for part in _place(error.errors()[0])])


def _place(error: Mapping[str, Any]) -> tuple[str | int, ...]:
    """The keys to the value, without the type that pydantic puts behind them if a value may have several."""
    place: tuple[str | int, ...] = error["loc"]
    return place[:-1] if error["type"].endswith("_type") and {*place[-1:]} & _TYPES else place


def _expected(error: Mapping[str, Any]) -> str:
    if error["type"] in _EXPECTED:
        return "expected " + _EXPECTED[error["type"]].format_map(error.get("ctx", {}))
    return str(error["msg"]).replace("Input should be", "expected", 1)
