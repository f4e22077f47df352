"""Read-only arrays of a frozen dataclass."""

from __future__ import annotations

import numpy as np

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
