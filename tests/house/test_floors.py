"""Imports between folders, size and names of files, the example configuration, uses of effective_config."""

import ast
import re
import tomllib
from pathlib import Path

import pytest
import scipy.constants

from recordings import standard_gravity
from station.config import StationConfig, load_config, nested_keys, parse_config
from tests.house.sources import ROOT, SOURCES, name_of, nodes_of, run_python, text_of

PACKAGES = ("station", "drivers", "recordings", "fitting", "solver", "documents")
DRAWERS = {"utils", "util", "misc", "helpers", "common", "core", "base", "manager"}


def test_imports_keep_the_contracts() -> None:
    """In a process of its own: the linter turns off every logger that is there already."""
    look = "import sys; from importlinter.cli import lint_imports; sys.exit(lint_imports(no_cache=True))"
    seen = run_python("-c", look)
    assert seen.returncode == 0, seen.stdout


LONGEST = {
    "drivers/qualisys.py": 529,
    "fitting/diagnosis/causes.py": 531,
    "solver/tendons/fiber.py": 524,
    "station/validation/lifts.py": 521,
}
"""Lines of files that have taken in a neighbour and are not yet shorter; none may grow."""


def test_a_file_is_short_and_named_by_its_noun() -> None:
    """A file has usually 150 to 500 lines (CONTRIBUTING): one noun with the functions that only it uses. A lower limit
    would split a noun over files that no other file imports.
    """
    lines = {name_of(path): text_of(path).count("\n") for path in SOURCES}
    assert {name for name, count in lines.items() if count > LONGEST.get(name, 500)} == set()
    assert {name for name in LONGEST if lines[name] <= 500} == set(), "these are short: take them out of the list"
    assert {name_of(path) for path in SOURCES if path.stem in DRAWERS} == set()
    long = [
        f"{name_of(path)}: {node.name}"
        for path in SOURCES
        for node in nodes_of(path)
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef) and (node.end_lineno or 0) - node.lineno >= 60
    ]
    assert long == []


def test_no_child_reads_standard_input_and_no_thread_waits_in_a_read_of_it() -> None:
    """On Windows a pending read of a pipe blocks libraries that load (docs/decisions/settled.md)."""
    starting = {name_of(path) for path in SOURCES if re.search(r"Popen\(|create_subprocess|\bos\.spawn", text_of(path))}
    assert starting == {"station/child.py", "station/viewer/viewer.py"}, "children are started with a Child"
    assert all("stdin=subprocess.DEVNULL" in text_of(ROOT / name) for name in starting)
    reading = {name_of(path) for path in SOURCES if "sys.stdin" in text_of(path)}
    assert reading == {
        "drivers/simulators/__main__.py",  # no thread
        "station/bench/simulation.py",  # passes it to standard_input.py
        "station/standard_input.py",  # asks for data before it reads
        "station/terminal/commands.py",  # also; keys of a terminal are read on POSIX only
    }
    assert "Thread" not in text_of(ROOT / "drivers/simulators/__main__.py")


def test_standard_gravity_is_typed_once_and_scipy_s() -> None:
    typed = {
        name_of(path)
        for path in SOURCES
        if "9.8" in text_of(path)
        for node in nodes_of(path)
        if isinstance(node, ast.Constant) and re.search(r"\b9\.8(0|1|\b)", str(node.value))
    }
    assert typed == {"recordings/standard_gravity.py"}
    assert standard_gravity.g == scipy.constants.g


@pytest.mark.parametrize("package", [*PACKAGES, "drivers/simulators"])
def test_a_package_s_init_is_empty_so_that_every_file_is_named(package: str) -> None:
    assert (ROOT / package / "__init__.py").read_text(encoding="utf-8") == ""


def test_the_example_is_understood_has_four_cuffs_and_every_key_with_its_default() -> None:
    config = load_config(ROOT / "station.toml")
    assert {config.cuff_site(name).site for name in ("hand", "tube", "elbow")} == {"arm"}
    assert config.cuff_site("waist").site == "waist"
    text = (ROOT / "station.toml").read_text(encoding="utf-8")
    unnamed = {key for key in nested_keys(StationConfig) if not re.search(rf"\b{key}\b", text)}
    assert unnamed == {"simulation"}, "the simulators' own section is theirs to explain"
    hidden = "".join(re.findall(r"^# \[(?:safety|session)\].*\n(?:# \w+ = .*\n)+", text, re.M))
    shown = parse_config(tomllib.loads(re.sub("^# ", "", hidden, flags=re.M)), "the example's comments")
    assert (shown.safety, shown.session) == (StationConfig().safety, StationConfig().session)
    assert {"safety", "session"} <= shown.model_fields_set


def test_the_readme_sets_up_and_tests_in_its_first_two_blocks_of_one_line_each() -> None:
    blocks = re.findall(r"^```\w*\n(.*?)^```", (ROOT / "README.md").read_text(encoding="utf-8"), re.M | re.S)
    assert [block.strip().count("\n") for block in blocks[:2]] == [0, 0]
    assert "station demo" in blocks[0]
    assert "pytest" in blocks[1]


def test_all_packages_of_the_picture_are_installed_with_the_distribution() -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
    included = project["tool"]["setuptools"]["packages"]["find"]["include"]
    assert included == [f"{package}*" for package in ("cuffstation", *PACKAGES)]
    assert "py.typed" in project["tool"]["setuptools"]["package-data"]["*"]
    assert all((ROOT / package / "py.typed").is_file() for package in ("cuffstation", *PACKAGES)), "types for users"
    assert f"version: {project['project']['version']}\n" in (ROOT / "CITATION.cff").read_text(encoding="utf-8")
    assert project["project"]["scripts"] == {"station": "station.__main__:main"}


NAME = "effective_config"
ALLOWED = {
    "recordings/manifest.py": "declares it",
    "station/files/timed_replay.py": "replays with it",
    "station/live/engine.py": "replays with it",
    "station/trial_manifest.py": "writes it",
}


def test_only_audit_and_replay_mention_the_configuration_that_was_in_force() -> None:
    mentioning = {name_of(path) for path in SOURCES if NAME in text_of(path) and _mentions(path)}
    assert mentioning == set(ALLOWED)


def _mentions(path: Path) -> bool:
    """Whether the code, beyond docstrings, uses the name as an attribute, a variable, a keyword or a key."""
    used = (getattr(node, field, None) for node in nodes_of(path) for field in ("attr", "id", "arg", "value"))
    return any(isinstance(found, str) and found == NAME for found in used)
