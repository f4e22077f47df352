"""Source distribution and wheel: the same bytes from the same content, with examples, tests and the sample session."""

from __future__ import annotations

import hashlib
import os
import subprocess
import sys
import tarfile
import zipfile
from pathlib import Path

import pytest

from station.files.init import InitError, write_examples
from station.messages.setup_messages import ConfigCode
from tests.station.refusals import raises_refusal
from tests.timeout import scaled_timeout

ROOT = Path(__file__).parents[2]
BUILD = "import sys; from setuptools import build_meta as b; to = sys.argv[1]; b.build_sdist(to); b.build_wheel(to)"


def distributions(folder: Path) -> dict[str, Path]:
    """Suffix → sdist and wheel of a copy of the checkout, whose files are as old and as readable as the copy."""
    listing = ["git", "ls-files", "--cached", "--others", "--exclude-standard"]
    listed = subprocess.run(listing, cwd=ROOT, capture_output=True, text=True, check=True)  # noqa: S603
    for name in filter(None, listed.stdout.splitlines()):
        if (ROOT / name).is_file():  # not deleted in the working tree
            (folder / "tree" / name).parent.mkdir(parents=True, exist_ok=True)
            (folder / "tree" / name).write_bytes((ROOT / name).read_bytes())
    subprocess.run(  # noqa: S603
        [sys.executable, "-c", BUILD, str(folder)],
        cwd=folder / "tree",
        env={**os.environ, "SOURCE_DATE_EPOCH": "1764115200"},
        capture_output=True,
        timeout=scaled_timeout(200),
        check=True,
    )
    return {path.suffix: path for path in (*folder.glob("*.tar.gz"), *folder.glob("*.whl"))}


@pytest.mark.slow
def test_two_builds_have_the_same_bytes_and_hold_what_a_user_needs(tmp_path: Path) -> None:
    first, second = (distributions(tmp_path / name) for name in ("first", "second"))
    assert [hashlib.sha256(path.read_bytes()).digest() for path in first.values()] == [
        hashlib.sha256(path.read_bytes()).digest() for path in second.values()
    ]
    with tarfile.open(first[".gz"]) as archive:
        names = {name.partition("/")[2] for name in archive.getnames()}
    assert {"tests/conftest.py", "examples/leg/leg.osim", "station/sample_session/test-bounce_run-1.mcap"} <= names
    with zipfile.ZipFile(first[".whl"]) as wheel:
        shared = {name.partition("share/cuffstation/")[2] for name in wheel.namelist()}
        assert {"station.toml", "examples/fit_a_cuff.py", "examples/leg/leg.osim"} <= shared
        assert "station/sample_session/test-bounce_run-1.mcap" in wheel.namelist()


def test_the_configuration_and_the_examples_are_written_and_no_file_is_replaced(tmp_path: Path) -> None:
    assert write_examples(tmp_path) == [tmp_path / "station.toml", tmp_path / "examples"]
    assert (tmp_path / "station.toml").read_bytes() == (ROOT / "station.toml").read_bytes()
    written = {path.relative_to(tmp_path / "examples") for path in (tmp_path / "examples").rglob("*.*")}
    assert {Path("fit_a_cuff.py"), Path("leg/stride.mot")} <= written
    (tmp_path / "station.toml").write_text("mine", encoding="utf-8")
    with raises_refusal(InitError, ConfigCode.EXISTS):
        write_examples(tmp_path)
    assert (tmp_path / "station.toml").read_text(encoding="utf-8") == "mine"
