"""Dependencies of other platforms, resolved by wheels alone: what is said without an index, and of a missing wheel."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

from benchmarks.wheels import ROOT, refused, resolve


def test_without_a_package_index_the_platforms_are_skipped_with_a_message(tmp_path: Path) -> None:
    environment = {**os.environ, "UV_OFFLINE": "1", "UV_CACHE_DIR": str(tmp_path), "PYTHONPATH": str(ROOT)}
    ran = subprocess.run(
        [sys.executable, "-m", "benchmarks.wheels"], capture_output=True, text=True, check=False, env=environment
    )
    assert ran.returncode == 0 and ran.stdout == ""
    assert ran.stderr.startswith("skipped: no package index can be reached")


def test_a_package_without_a_wheel_is_no_lack_of_an_index() -> None:
    """uv's own words, of numba on an Intel Mac."""
    words = (
        "error: No solution found when resolving dependencies\n  cause: Because numba>=0.63.0 has no usable wheels and "
        "cuffstation depends on numba>=0.63, we can conclude that your requirements are unsatisfiable."
    )
    found = refused(words)
    assert not found.is_offline and found.count == 0 and "numba" in found.why


def test_a_project_that_needs_nothing_is_resolved_offline(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("UV_OFFLINE", "1")
    (tmp_path / "pyproject.toml").write_text(
        '[project]\nname = "a"\nversion = "1"\ndependencies = []\n[project.optional-dependencies]\nstation = []\n'
    )
    found = resolve("x86_64-pc-windows-msvc", tmp_path / "pyproject.toml")
    assert (found.count, found.is_offline, found.why) == (0, False, "")
