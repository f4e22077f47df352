"""What a verb's exit code means, the same for every verb."""

from __future__ import annotations

DONE = 0
FAILED = 1
WRONG_USAGE = 2
LOSSY = 3
"""Something is there, and something is missing: a trial was recorded with losses, or ended before its end (a device or
the disk was gone) and is not accepted; a file was recovered in part; a frame stayed unsolved. What and why is said."""
INTERRUPTED = 130  # as a shell counts what a signal ended
