"""Read-only arrays: of a frozen dataclass, and for compiled code."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from solver.errors import ModelError, SolverCode


def freeze_arrays(noun: object, **shapes: tuple[int, ...]) -> None:
    """Replace fields by read-only float arrays. Raises ModelError for another shape than the given one."""
    for field, shape in shapes.items():
        values = np.array(getattr(noun, field), dtype=np.float64)
        if values.shape != shape:
            sentence = f"{type(noun).__name__}.{field} has shape {values.shape}, expected {shape}"
            raise ModelError(sentence, SolverCode.WRONG_SHAPE)
        values.flags.writeable = False
        object.__setattr__(noun, field, values)


def read_only(values: NDArray[np.float64]) -> NDArray[np.float64]:
    """The values as a contiguous read-only array: for the compiler, arrays of another kind are of another type."""
    view = np.ascontiguousarray(values).view()
    view.flags.writeable = False
    return view
