"""The root of what the solver raises.

SolverError
├── ModelError   a model, or an option for it, that cannot be solved (model.py)
├── MotionError  a motion that does not fit the model (motion.py)
└── SuitError    a suit that the model cannot wear (suit/suit.py)
"""

from __future__ import annotations


class SolverError(ValueError):
    """One sentence for the analyst; a second may say what to do."""

    exit_code = 1
