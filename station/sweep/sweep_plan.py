"""The plan of a sweep, a TOML file with axes and design. Paths in it are relative to that file."""

from __future__ import annotations

import hashlib
import itertools
import math
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Literal, get_args

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, TypeAdapter, ValidationError, model_validator

from documents.message import Message
from documents.plain_data import LARGEST_TOML, parse_toml
from documents.regular_file import read_regular
from documents.validation import NonNegative, Positive, Section, Vector, Whole, describe_error, refused_as
from solver.suit.cord import Condition
from station.defaults import CUTOFF_HZ
from station.errors import StationError
from station.messages.study_messages import SweepCode
from station.sources import BUNDLED

Value = str | float | tuple[float, ...]
Point = dict[str, Value]
"""One point of the design: axis → value."""

NONE = "none"
MOST_POINTS = 1_000_000
NAME: TypeAdapter[Any] = TypeAdapter(Annotated[str, Field(min_length=1)])
CONDITION: TypeAdapter[Any] = TypeAdapter(Condition)
MASS: TypeAdapter[Any] = TypeAdapter(NonNegative)
POSITIVE: TypeAdapter[Any] = TypeAdapter(Positive)
POINT: TypeAdapter[Any] = TypeAdapter(Vector)
AXES: dict[str, TypeAdapter[Any]] = {
    "model": NAME,
    "motion": NAME,
    "external_loads": NAME,
    "hand_mass_kg": MASS,
    "suit": NAME,
    "rest_length_m": POSITIVE,
    "stiffness_n_per_m": POSITIVE,
    "waist_point_m": POINT,
    "shoulder_point_m": POINT,
    "arm_point_m": POINT,
    "cuffs": NAME,
    "cuff": NAME,
    "condition": CONDITION,
}
"""Axes: files, names, a mass, and parameters of the suit."""


class PlanError(StationError):
    """The plan cannot be used."""


@dataclass(frozen=True)
class Span:
    """Range of a sample: a number between first and last, or a point in the box between these two corners."""

    first: tuple[float, ...]
    last: tuple[float, ...]


@dataclass(frozen=True)
class SweepPlan:
    """Axes and design of a sweep.

    axes    name → values, or the span of a sample; in the order of AXES
    method  "grid", "latin_hypercube" or "random"; count and seed: of a sample
    every   muscles are solved in every N-th frame
    cutoff_hz  of the low-pass filter of the motions, None for no filter
    digest  SHA-256 of the file
    """

    folder: Path
    axes: dict[str, tuple[Value, ...] | Span]
    method: str
    count: int
    seed: int
    every: int
    digest: str
    cutoff_hz: float | None = CUTOFF_HZ

    def values(self, axis: str) -> tuple[Value, ...]:
        """The values of an axis; empty for a span."""
        found = self.axes.get(axis, ())
        return () if isinstance(found, Span) else found

    def points(self) -> Iterator[Point]:
        """The design, in an order that depends on the plan only."""
        if self.method == "grid":
            for values in itertools.product(*map(self.values, self.axes)):
                yield dict(zip(self.axes, values, strict=True))
            return
        for row in _unit_samples(self):
            yield {name: _value_at(axis, sample) for (name, axis), sample in zip(self.axes.items(), row, strict=True)}


def read_plan(path: Path) -> SweepPlan:
    """Read a plan. Raises PlanError, which names a key that is missing, unknown or out of range."""
    with refused_as(PlanError, path, SweepCode.UNREADABLE, SweepCode.WRONG_TABLE):
        content = read_regular(path, LARGEST_TOML)
        table = _PlanTable.model_validate(parse_toml(content))
    axes = _axes(table)
    points = math.prod(len(axis) for axis in axes.values() if not isinstance(axis, Span))
    if table.method == "grid" and points > MOST_POINTS:
        raise PlanError(Message(SweepCode.TOO_MANY_POINTS, {"points": points, "most": MOST_POINTS}))
    return SweepPlan(
        folder=path.resolve().parent,
        axes=axes,
        method=table.method,
        count=table.count,
        seed=table.seed,
        every=table.every,
        digest=hashlib.sha256(content).hexdigest(),
        cutoff_hz=table.cutoff_hz or None,
    )


def _unit_samples(plan: SweepPlan) -> NDArray[np.float64]:
    """Samples (count, axes, 3) in [0, 1); a column of a Latin hypercube has one sample in each of count intervals."""
    generator = np.random.default_rng(plan.seed)
    samples = generator.random((plan.count, len(plan.axes), 3))
    if plan.method == "latin_hypercube":
        parts = np.tile(np.arange(plan.count)[:, None, None], (1, *samples.shape[1:]))
        samples = (generator.permuted(parts, axis=0) + samples) / plan.count
    return samples


def _value_at(axis: tuple[Value, ...] | Span, sample: NDArray[np.float64]) -> Value:
    if not isinstance(axis, Span):
        return axis[int(sample[0] * len(axis))]
    first, last = np.array(axis.first), np.array(axis.last)
    value = (first + sample[: len(first)] * (last - first)).tolist()
    return tuple(value) if len(value) > 1 else float(value[0])


def _axes(table: _PlanTable) -> dict[str, tuple[Value, ...] | Span]:
    given = table.vary.model_dump(exclude_none=True)
    return {name: _axis(given[name], name, is_sample=table.method != "grid") for name in AXES if name in given}


def _axis(given: Any, name: str, *, is_sample: bool) -> tuple[Value, ...] | Span:
    """Parse a value, a list of values, or the span { first, last } of a sample; a point is a list of numbers."""
    kind, where = AXES[name], f"vary.{name}"
    if isinstance(given, dict):
        if not is_sample or kind in (NAME, CONDITION) or given.keys() != {"first", "last"}:
            raise PlanError(Message(SweepCode.SPAN_OF_GRID, {"axis": where}))
        first, last = (np.atleast_1d(np.array(_value(kind, given[end], where))).tolist() for end in ("first", "last"))
        return Span(tuple(first), tuple(last))
    is_single = not isinstance(given, list) or (kind is POINT and not any(isinstance(value, list) for value in given))
    values = tuple(_value(kind, value, where) for value in ([given] if is_single else given))
    if not values:
        raise PlanError(Message(SweepCode.EMPTY_AXIS, {"axis": where}))
    return values


def _value(kind: TypeAdapter[Any], given: Any, where: str) -> Value:
    try:
        value: Value = kind.validate_python(given)
    except ValidationError as error:
        raise PlanError(Message(SweepCode.WRONG_VALUE, {"reason": describe_error(error, context=where)})) from error
    return value


class _VaryTable(Section):
    """The keys of [vary] and their defaults; the default of a parameter of the suit is the value in its file."""

    model: Any = BUNDLED
    motion: Any = BUNDLED
    external_loads: Any = NONE
    hand_mass_kg: Any = 0.0
    suit: Any = BUNDLED
    rest_length_m: Any = None
    stiffness_n_per_m: Any = None
    waist_point_m: Any = None
    shoulder_point_m: Any = None
    arm_point_m: Any = None
    cuffs: Any
    cuff: Any
    condition: Any = Field(default_factory=lambda: list(get_args(Condition)))


class _PlanTable(Section):
    """The keys of a plan."""

    every: Annotated[Whole, Field(ge=1)] = 1
    cutoff_hz: NonNegative = CUTOFF_HZ
    method: Literal["grid", "latin_hypercube", "random"] = "grid"
    count: Annotated[Whole, Field(ge=1, le=MOST_POINTS)] = 1
    seed: Annotated[Whole, Field(ge=0)] = 0
    vary: _VaryTable

    @model_validator(mode="after")
    def _sample_has_a_count(self) -> _PlanTable:
        if self.method != "grid" and "count" not in self.model_fields_set:
            raise ValueError(f"a {self.method} sample needs count, the number of its points; add it")
        return self
