"""Defaults of options; a file of its own, because the command line starts with it.

Cut-offs are those of the low-pass filter of motions.
"""

from __future__ import annotations

CUTOFF_HZ = 3.0
"""Of the published study; gait needs about 6."""
OPENSIM_CUTOFF_HZ = 6.0
"""Of analyses that OpenSim's tools have too: inverse dynamics and static optimisation, usually of gait."""


LEAST_DRAWS = 40
"""From 39 draws on the order statistics of a 95 % interval exist: the least and the greatest of 39 draws."""
