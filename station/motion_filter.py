"""Default cut-offs of the low-pass filter of motions; a file of its own, because the command line starts with it."""

from __future__ import annotations

CUTOFF_HZ = 3.0
"""Of the published study; gait needs about 6."""
OPENSIM_CUTOFF_HZ = 6.0
"""Of analyses that OpenSim's tools have too: inverse dynamics and static optimisation, usually of gait."""
