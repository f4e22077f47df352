"""The root of what the station raises; its exit code is that of the verb."""

from __future__ import annotations

from station.exit_code import FAILED


class StationError(Exception):
    """One sentence for the operator; a second may say what to do."""

    exit_code = FAILED
