"""The plan of a sweep: what is varied and how, from a TOML file. Paths in it are relative to that file."""

from __future__ import annotations

import hashlib
import itertools
import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, get_args

import numpy as np
from numpy.typing import NDArray

from documents.plain_data import LARGEST_TOML, PlainDataError, parse_toml, shortened
from documents.regular_file import read_regular
from solver.suit.scenarios import Condition
from station.assessment.sources import BUNDLED

Value = str | float | tuple[float, ...]
Point = dict[str, Value]
"""Axis → its value: one point of the design."""

NONE = "none"
METHODS = ("grid", "latin_hypercube", "random")
MOST_POINTS = 1_000_000
KEYS = ("every", "method", "count", "seed", "vary")


class PlanError(Exception):
    """A plan that cannot be swept; one sentence."""


@dataclass(frozen=True)
class Span:
    """A sample draws from anywhere between these two, a point from the box between two corners."""

    first: tuple[float, ...]
    last: tuple[float, ...]


@dataclass(frozen=True)
class SweepPlan:
    """What is varied.

    axes    name → the values it has, or the span it is drawn from; in the order of AXES
    method  one of METHODS; count and seed are a sample's
    every   muscles are solved in every N-th frame
    digest  SHA-256 of the file
    """

    folder: Path
    axes: dict[str, tuple[Value, ...] | Span]
    method: str
    count: int
    seed: int
    every: int
    digest: str

    def values(self, axis: str) -> tuple[Value, ...]:
        """All that an axis without a span may be."""
        found = self.axes.get(axis, ())
        return () if isinstance(found, Span) else found

    def points(self) -> Iterator[Point]:
        """The design, in an order that the plan alone decides."""
        if self.method == "grid":
            for values in itertools.product(*map(self.values, self.axes)):
                yield dict(zip(self.axes, values, strict=True))
            return
        for row in _shares(self):
            yield {name: _drawn(axis, share) for (name, axis), share in zip(self.axes.items(), row, strict=True)}


def read_plan(path: Path) -> SweepPlan:
    """Raises PlanError, naming the key that is missing, unknown or out of range."""
    try:
        content = read_regular(path, LARGEST_TOML)
        document = parse_toml(content)
    except (OSError, PlainDataError) as error:
        raise PlanError(f"{path} should be a plan in TOML and cannot be read ({error}); correct it") from error
    _ensure_known(document, "plan", KEYS)
    method = document.get("method", "grid")
    if method not in METHODS:
        raise PlanError(
            f"the plan's method should be one of {', '.join(METHODS)} and is {shortened(method)}; correct it"
        )
    if method != "grid" and "count" not in document:
        raise PlanError(f"the plan should say by count how many points a {method} sample has, and does not; add it")
    axes = _axes(document.get("vary"), is_sample=method != "grid")
    points = math.prod(len(axis) for axis in axes.values() if not isinstance(axis, Span))
    if method == "grid" and points > MOST_POINTS:
        raise PlanError(f"the plan's grid has {points} points, expected at most {MOST_POINTS}; vary less at once")
    return SweepPlan(
        folder=path.resolve().parent,
        axes=axes,
        method=method,
        count=_whole(document, "count", 1, MOST_POINTS),
        seed=_whole(document, "seed", 0),
        every=_whole(document, "every", 1),
        digest=hashlib.sha256(content).hexdigest(),
    )


def _shares(plan: SweepPlan) -> NDArray[np.float64]:
    """(count, axes, 3) from 0 to 1; in a Latin hypercube, each column has one in every count-th part of that."""
    generator = np.random.default_rng(plan.seed)
    shares = generator.random((plan.count, len(plan.axes), 3))
    if plan.method == "latin_hypercube":
        parts = np.tile(np.arange(plan.count)[:, None, None], (1, *shares.shape[1:]))
        shares = (generator.permuted(parts, axis=0) + shares) / plan.count
    return shares


def _drawn(axis: tuple[Value, ...] | Span, share: NDArray[np.float64]) -> Value:
    if not isinstance(axis, Span):
        return axis[int(share[0] * len(axis))]
    first, last = np.array(axis.first), np.array(axis.last)
    drawn = (first + share[: len(first)] * (last - first)).tolist()
    return tuple(drawn) if len(drawn) > 1 else float(drawn[0])


def _axes(table: Any, *, is_sample: bool) -> dict[str, tuple[Value, ...] | Span]:
    if not isinstance(table, dict):
        raise PlanError(f"the plan should have a table vary with one of {', '.join(AXES)} or more; add it")
    _ensure_known(table, "plan's vary", tuple(AXES))
    for key in ("cuffs", "cuff"):
        if key not in table:
            raise PlanError(f"the plan's vary should name {key} and does not; add it")
    given = DEFAULTS | table
    return {name: _axis(given[name], name, is_sample=is_sample) for name in AXES if name in given}


def _axis(given: Any, name: str, *, is_sample: bool) -> tuple[Value, ...] | Span:
    """A value, a list of them, or { first, last }; a point is itself a list, of numbers."""
    read, where = AXES[name], f"the plan's vary.{name}"
    if isinstance(given, dict):
        _ensure_known(given, f"plan's vary.{name}", ("first", "last"))
        if not is_sample or read in (_word, _condition) or len(given) < 2:
            raise PlanError(f"{where} should be a list of values: only numbers of a sample have first and last")
        first, last = (np.atleast_1d(np.array(read(given[end], where))).tolist() for end in ("first", "last"))
        return Span(tuple(first), tuple(last))
    is_single = not isinstance(given, list) or (read is _point and not any(isinstance(each, list) for each in given))
    values = tuple(read(each, where) for each in ([given] if is_single else given))
    if not values:
        raise PlanError(f"{where} should have a value and is empty; add one or leave it out")
    return values


def _word(value: Any, where: str) -> Value:
    if not isinstance(value, str) or not value:
        raise PlanError(f"{where} should be a name and is {shortened(value)}; correct it")
    return value


def _condition(value: Any, where: str) -> Value:
    if value not in get_args(Condition):
        raise PlanError(
            f"{where} should be one of {', '.join(get_args(Condition))} and is {shortened(value)}; correct it"
        )
    return str(value)


def _number(value: Any, where: str) -> Value:
    if not _is_finite(value) or value < 0:
        raise PlanError(f"{where} should be a number that is not negative and is {shortened(value)}; correct it")
    return float(value)


def _above_zero(value: Any, where: str) -> Value:
    if not _is_finite(value) or value <= 0:
        raise PlanError(f"{where} should be a number above 0 and is {shortened(value)}; correct it")
    return float(value)


def _point(value: Any, where: str) -> Value:
    if not (isinstance(value, list) and len(value) == 3 and all(map(_is_finite, value))):
        raise PlanError(f"{where} should be a point of three numbers and is {shortened(value)}; correct it")
    return tuple(float(each) for each in value)


def _is_finite(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and math.isfinite(value)


def _whole(document: dict[str, Any], key: str, least: int, most: int = 2**63) -> int:
    value = document.get(key, least)
    if isinstance(value, bool) or not isinstance(value, int) or not least <= value <= most:
        limits = f"from {least} on" if most == 2**63 else f"from {least} to {most}"
        raise PlanError(f"the plan's {key} should be a whole number {limits} and is {shortened(value)}; correct it")
    return value


def _ensure_known(table: dict[str, Any], where: str, keys: tuple[str, ...]) -> None:
    unknown = [key for key in table if key not in keys]
    if unknown:
        raise PlanError(f"the {where} has an unknown {', '.join(unknown)}; it may have {', '.join(keys)}")


AXES: dict[str, Callable[[Any, str], Value]] = {
    "model": _word,
    "motion": _word,
    "external_loads": _word,
    "hand_mass_kg": _number,
    "suit": _word,
    "rest_length_m": _above_zero,
    "stiffness_n_per_m": _above_zero,
    "waist_point_m": _point,
    "shoulder_point_m": _point,
    "arm_point_m": _point,
    "cuffs": _word,
    "cuff": _word,
    "condition": _condition,
}
"""What may be varied: files, names, a mass, and what is to be another in the suit."""

DEFAULTS: dict[str, Any] = {
    "model": BUNDLED,
    "motion": BUNDLED,
    "external_loads": NONE,
    "hand_mass_kg": 0.0,
    "suit": BUNDLED,
    "condition": list(get_args(Condition)),
}
"""What is not named; where the suit is concerned, it is as its file says."""
