"""Versions of the packages behind a recording or a result."""

from __future__ import annotations

import hashlib
import platform
from importlib import metadata, resources
from pathlib import Path

RECORDED = ("cuffstation", "nidaqmx", "qtm-rt", "pyserial", "mcap", "numpy")
SOLVING = ("cuffstation", "numpy", "scipy", "numba", "clarabel")


def installed_versions() -> dict[str, str]:
    """Version by package of Python and of the installed packages of RECORDED."""
    found = {"python": platform.python_version()}
    for name in RECORDED:
        try:
            found[name] = metadata.version(name)
        except metadata.PackageNotFoundError:
            continue
    return found


def solving_versions() -> dict[str, str]:
    """Version by package of those that determine a result of the solver."""
    return {name: metadata.version(name) for name in SOLVING}


def solver_digest() -> str:
    """SHA-256 of the sources of the solver: during development they change, but the version does not."""
    root = Path(str(resources.files("solver")))
    digest = hashlib.sha256()
    for path in sorted(path for suffix in ("py", "toml") for path in root.rglob(f"*.{suffix}")):
        digest.update(path.relative_to(root).as_posix().encode() + b"\0" + path.read_bytes() + b"\0")
    return digest.hexdigest()
