"""Declared is what is imported; a small install does without the packages of every extra; wheels of other systems."""

import re
import subprocess
import tomllib
from importlib.metadata import packages_distributions
from pathlib import Path

import pytest
from packaging.requirements import Requirement

from benchmarks.wheels import refused, resolve
from station.extras import EXTRAS_OF_VERB, PACKAGES
from tests.house.sources import ROOT, run_python

PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
ONE_OF_EACH_EXTRA = ("check", "serve", "sweep")


def test_what_is_imported_is_declared_and_what_is_declared_is_imported() -> None:
    seen = run_python("-m", "deptry", "--no-ansi", ".")
    assert seen.returncode == 0, seen.stderr


def test_the_extras_are_those_that_are_declared_and_the_readme_installs_all() -> None:
    brought_by = {name: {_plain(found) for found in names} for name, names in packages_distributions().items()}
    for extra, packages in PACKAGES.items():
        declared = {_plain(Requirement(text).name) for text in PROJECT["optional-dependencies"][extra]}
        assert {distribution for package in packages for distribution in brought_by[package]} == declared, extra
        assert not declared & {_plain(Requirement(text).name) for text in PROJECT["dependencies"]}
    line = next(line for line in (ROOT / "README.md").read_text(encoding="utf-8").splitlines() if "-m venv" in line)
    assert "-e '.[station]'" in line
    (all_of_them,) = PROJECT["optional-dependencies"]["station"]
    assert Requirement(all_of_them).extras == set(PACKAGES)
    assert any("station" in Requirement(text).extras for text in PROJECT["optional-dependencies"]["test"])


@pytest.mark.slow
def test_the_library_and_the_verbs_of_an_analyst_run_without_an_extra(session: Path) -> None:
    recording = next(path for path in sorted(session.glob("*.mcap")) if "static" in path.name)
    replay = ("replay", recording, "--speed", "50")
    ran = _small("info", recording, "+", *replay, "+", "fit", session, "+", "report", session, "+", "library", session)
    assert ran.returncode == 0, ran.stderr
    assert re.search(r"^0 +hand +1 +stiffness", ran.stdout, re.MULTILINE), "the table of the library"


@pytest.mark.parametrize(
    "verb",
    [verb if verb in ONE_OF_EACH_EXTRA else pytest.param(verb, marks=pytest.mark.slow) for verb in EXTRAS_OF_VERB],
)
def test_a_verb_that_needs_an_extra_names_it_in_one_sentence(verb: str, tmp_path: Path) -> None:
    plan = ("plan.toml", "--output", "sweep") if verb == "sweep" else ()
    force = ("--config", "station.toml", "--session", "s") if verb == "record" else ()
    sessions = (".",) if verb == "catalogue" else ()
    ran = _small(verb, *plan, *force, *sessions, folder=tmp_path)
    (sentence,) = ran.stderr.splitlines()
    named = re.fullmatch(
        rf"station: station {verb} needs the package (\w+), .* pip install 'cuffstation\[([\w,]+)\]' "
        r"\[installation\.missing_package\]",
        sentence,
    )
    assert (ran.returncode, ran.stdout) == (1, "")
    assert named is not None, sentence
    assert named[2].split(",") == list(EXTRAS_OF_VERB[verb]), "one installation is enough"
    assert named[1] in PACKAGES[EXTRAS_OF_VERB[verb][0]]
    assert not list(tmp_path.iterdir()), "nothing was begun"


@pytest.mark.slow
def test_an_option_that_needs_an_extra_names_it_in_one_sentence(session: Path, tmp_path: Path) -> None:
    recording = next(session.glob("*.mcap"))
    drawn = ("replay", recording, "--rrd", "trial.rrd")
    ran = _small(*drawn, "+", "export", recording, "--to", "foxglove", "--output", "out", folder=tmp_path)
    assert ran.returncode == 1
    assert re.findall(r"pip install 'cuffstation\[(\w+)\]'", ran.stderr) == ["viewer", "formats"]
    assert "Traceback" not in ran.stderr


def _small(*words: object, folder: Path = ROOT) -> subprocess.CompletedProcess[str]:
    here = {"PYTHONPATH": str(ROOT), "MPLBACKEND": "agg"}
    return run_python("-m", "tests.house.small_install", *words, folder=folder, **here)


def _plain(distribution: str) -> str:
    return re.sub(r"[-_.]+", "-", distribution).lower()


def test_without_a_package_index_the_platforms_are_skipped_with_a_message(tmp_path: Path) -> None:
    ran = run_python("-m", "benchmarks.wheels", UV_OFFLINE="1", UV_CACHE_DIR=str(tmp_path))
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
