"""What the catalogue refuses."""

from __future__ import annotations

from station.errors import StationError


class CatalogueError(StationError):
    """The catalogue cannot be built, written or queried."""
