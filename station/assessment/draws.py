"""How many draws give 95 % intervals."""

from __future__ import annotations

LEAST_DRAWS = 40
"""From 39 draws on the order statistics of a 95 % interval exist: the least and the greatest of 39 draws."""
