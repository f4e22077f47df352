"""Which packages made a recording."""

from __future__ import annotations

import platform
from importlib import metadata

RECORDED = ("cuffstation", "nidaqmx", "qtm-rt", "pyserial", "mcap", "numpy")


def installed_versions() -> dict[str, str]:
    """Version by package, of Python and of those that are installed."""
    found = {"python": platform.python_version()}
    for name in RECORDED:
        try:
            found[name] = metadata.version(name)
        except metadata.PackageNotFoundError:
            continue
    return found
