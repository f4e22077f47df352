"""Simulated devices are recorded below a folder called simulated, and nowhere else."""

from pathlib import Path

import pytest


@pytest.fixture
def tmp_path(tmp_path: Path) -> Path:
    folder = tmp_path / "simulated"
    folder.mkdir()
    return folder
