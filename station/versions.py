"""Which packages made a recording, and which a result."""

from __future__ import annotations

import platform
from importlib import metadata

RECORDED = ("cuffstation", "nidaqmx", "qtm-rt", "pyserial", "mcap", "numpy")
SOLVING = ("cuffstation", "numpy", "scipy", "numba", "clarabel")


def installed_versions() -> dict[str, str]:
    """Version by package, of Python and of those that are installed."""
    found = {"python": platform.python_version()}
    for name in RECORDED:
        try:
            found[name] = metadata.version(name)
        except metadata.PackageNotFoundError:
            continue
    return found


def solving_versions() -> dict[str, str]:
    """Version by package, of those that decide a result of the solver."""
    return {name: metadata.version(name) for name in SOLVING}
