"""Validate documents with pydantic, and turn the first of its errors into one sentence."""

from __future__ import annotations

from pydantic import BaseModel, ConfigDict, ValidationError

from documents.plain_data import shortened


class Section(BaseModel):
    """A table of a document: unknown keys are refused, no number is read from a text or a Boolean, all are finite."""

    model_config = ConfigDict(extra="forbid", frozen=True, strict=True, allow_inf_nan=False)


def describe_error(error: ValidationError, *, context: str = "") -> str:
    """The first fault of a document: its key below `context`, what was found, what was expected; then how many more."""
    first, *more = error.errors()
    key = ".".join([context] * bool(context) + [str(part) for part in first["loc"]])
    if first["type"] == "extra_forbidden":
        sentence = f"unknown key {key}"
    elif first["type"] == "value_error":
        sentence = f"{key}: {first['ctx']['error']}" if key else str(first["ctx"]["error"])
    elif first["type"] == "missing":
        sentence = f"{key} is missing"
    else:
        sentence = f"{key} is {shortened(first['input'])}, {_expected(first['msg'])}"
    return sentence + (f" (and {len(more)} more)" if more else "")


def _expected(message: str) -> str:
    """pydantic's "Input should be a valid number" as "expected a valid number"."""
    for opening in ("Input should be ", "Input should have "):
        if message.startswith(opening):
            return f"expected {message.removeprefix(opening)}"
    return message[0].lower() + message[1:]
