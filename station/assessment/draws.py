"""How many draws of the cuffs give 95 % intervals."""

from __future__ import annotations

LEAST_DRAWS = 40
"""Of 40 draws one is expected beyond each end of the interval; fewer do not reach its ends."""
