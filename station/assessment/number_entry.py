"""Numbers of assessment.json: a value with its 95 % interval."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import BaseModel, ConfigDict, Field


class StrictEntry(BaseModel):
    """An entry of a file of results; a number is not accepted as a text."""

    model_config = ConfigDict(strict=True)


class NumberEntry(StrictEntry):
    """A number with its 95 % interval; value is null where it is unknown."""

    value: float | None
    ci95: Annotated[list[float], Field(min_length=2, max_length=2)] | None = None
    censored: Annotated[
        Literal["low", "high", "both"] | None,
        Field(description="end of ci95 that is a bound: it lies there or beyond, outside the rest lengths tried"),
    ] = None


class KnownNumberEntry(NumberEntry):
    """A number that is always known."""

    value: float
