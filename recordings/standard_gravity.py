"""Standard gravity. scipy.constants has it too, and would take a third of the time in which the recorder starts."""

from __future__ import annotations

g = 9.80665
"""m/s², exact by definition (3rd CGPM, 1901)."""
