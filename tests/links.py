"""Symbolic links for tests, where the system lets this user make them."""

from pathlib import Path

import pytest

PRIVILEGE_NOT_HELD = 1314
"""Windows' error code: only administrators, and all users in its developer mode, may make symbolic links."""


def symlink(link: Path, target: Path) -> None:
    try:
        link.symlink_to(target)
    except OSError as error:
        if getattr(error, "winerror", None) != PRIVILEGE_NOT_HELD:
            raise
        pytest.skip("this user may not make symbolic links")
    if not link.is_symlink():
        pytest.skip("CreateSymbolicLinkW of Wine is a stub that reports success (WINEDEBUG=fixme+file shows it)")
