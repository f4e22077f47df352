"""Equality of results that hold arrays, for which the equality of a dataclass raises ValueError."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import fields, is_dataclass

import numpy as np


class EqualByFields:
    """Base of a dataclass with eq=False: equal if the types and all fields are, arrays element by element.

    NaN is equal to NaN, because it marks the same gap in both. Such an object has no hash.
    """

    __hash__ = None  # type: ignore[assignment]

    def __eq__(self, other: object) -> bool:
        return type(self) is type(other) and are_equal(self, other)


def are_equal(one: object, other: object) -> bool:
    """Whether two values are equal, within dataclasses, mappings and sequences also."""
    arrays = np.ndarray | np.generic | float
    if isinstance(one, arrays) and isinstance(other, arrays):
        one, other = np.asarray(one), np.asarray(other)
        has_gaps = one.dtype.kind in "fc" and other.dtype.kind in "fc"
        return bool(np.array_equal(one, other, equal_nan=has_gaps))
    if type(one) is not type(other):
        return not isinstance(one, np.ndarray) and not isinstance(other, np.ndarray) and bool(one == other)
    if is_dataclass(one) and not isinstance(one, type):
        return all(are_equal(getattr(one, field.name), getattr(other, field.name)) for field in fields(one))
    if isinstance(one, Mapping) and isinstance(other, Mapping):
        return one.keys() == other.keys() and all(are_equal(value, other[key]) for key, value in one.items())
    if isinstance(one, list | tuple) and isinstance(other, list | tuple):
        return len(one) == len(other) and all(map(are_equal, one, other))
    return bool(one == other)
