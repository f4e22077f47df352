"""Checks of arguments in Python: values of options, and arrays of frozen dataclasses."""

from __future__ import annotations

from collections.abc import Collection
from numbers import Integral
from os import PathLike

import numpy as np

from solver.errors import ModelError, SolverCode


def ensure_known(option: str, value: object, known: Collection[object]) -> None:
    """Raise ModelError for a value that is none of those known: most would act as the default does."""
    if value not in known:
        sentence = f"{option} is {value!r}, expected {' or '.join(map(repr, known))}; give one of these"
        raise ModelError(sentence, SolverCode.WRONG_OPTION)


def ensure_at_least(option: str, value: int, least: int) -> None:
    """Raise ModelError for a value that is no whole number, or a smaller one."""
    if not isinstance(value, Integral) or value < least:
        sentence = f"{option} is {value!r}, expected a whole number of at least {least}; give one"
        raise ModelError(sentence, SolverCode.WRONG_OPTION)


def ensure_type(argument: str, value: object, kind: type | tuple[type, ...], expected: str) -> None:
    """Raise TypeError for an argument of another type, as where two are exchanged or a path is given."""
    if not isinstance(value, kind):
        raise TypeError(f"{argument} should be {expected}, and got a {type(value).__name__}")


def ensure_names(option: str, names: Collection[str | PathLike[str]]) -> None:
    """Raise ModelError for a single name in place of several: the letters of a text would be taken for names."""
    if isinstance(names, str | PathLike):
        sentence = f"{option} is {names!r}, expected several names; write ({names!r},) for one"
        raise ModelError(sentence, SolverCode.WRONG_OPTION)


def freeze_arrays(noun: object, **shapes: tuple[int, ...]) -> None:
    """Replace fields by read-only float arrays. Raises ModelError for another shape than the given one."""
    for field, shape in shapes.items():
        values = np.array(getattr(noun, field), dtype=np.float64)
        if values.shape != shape:
            sentence = f"{type(noun).__name__}.{field} has shape {values.shape}, expected {shape}"
            raise ModelError(sentence, SolverCode.WRONG_SHAPE)
        values.flags.writeable = False
        object.__setattr__(noun, field, values)
