"""Exit codes, the same for every verb."""

from __future__ import annotations

DONE = 0
FAILED = 1
WRONG_USAGE = 2
LOSSY = 3
"""A result with a part missing, which a message explains: a trial with lost samples or an early end, a file that was
recovered in part, an unsolved frame."""
INTERRUPTED = 130  # as a shell reports SIGINT
ENDED_BY_CTRL_C = "station: ended by Ctrl-C; finished results are kept"
