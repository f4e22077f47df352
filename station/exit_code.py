"""What a verb's exit code means, the same for every verb."""

from __future__ import annotations

DONE = 0
FAILED = 1
WRONG_USAGE = 2
LOSSY = 3
"""Done, but recorded data was lost, or a frame stayed unsolved."""
