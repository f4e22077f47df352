"""One name for one thing: public classes are named once in the tree, and names that were given up stay so."""

from __future__ import annotations

import ast
import io
import re
import tokenize
from collections import defaultdict
from functools import cache
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
FOLDERS = ("cuffstation", "station", "drivers", "recordings", "fitting", "solver", "documents")
SOURCES = [path for folder in FOLDERS for path in sorted((ROOT / folder).rglob("*.py"))]
PAGES = [
    path
    for path in (*ROOT.glob("*.md"), *(ROOT / "docs").rglob("*.md"), *(ROOT / "recordings").rglob("*.md"))
    if path.name != "CHANGELOG.md" and "decisions" not in path.parts
]

GIVEN_UP = {
    "Announcer": "AudioAlerts",
    "Conversation": "QtmConnection",
    "Daemon": "TrialRecorder",
    "Doorkeeper": "AccessMiddleware",
    "Hearing": "StreamWatchdog",
    "Reach": "StreamClock",
    "Room": "Workspace",
    "Sureness": "UncertaintySummary",
    "Thinning": "Decimator",
    "TrialSession": "states of a trial",
    "TurnedBack": "LagPosterior",
    "Wearing": "SuitScenario",
    "Wishes": "QtmSettings",
    "WornMotion": "SuitedMotion",
    "faithful": "opensim",
    "feigned": "apparent_damping",
    "go_through": "evaluate_motion",
    "left_over": "residual_rms",
    "read_source": "read_regular",
    "refuted_by": "with_diagnosis",
    "room_for": "allocate",
    "stairs": "piecewise_constant",
    "sum_up": "summarise",
    "weigh": "mass_matrix_and_bias",
}
"""Name of before → the field's word."""
PHRASES = ("nothing speaks against", "talk to stderr", "stderr talk", "a session, or one to go on with")
STILL_READ = {("station/verbs/options.py", "faithful")}
"""Where an old name is read on purpose: an option's value of before."""

EMPTY_NOUNS = {"each", "words", "said", "way", "ways"}
"""No names for a value: they tell nothing of it."""
GROUND = ("drivers", "recordings", "solver", "documents", "cuffstation")


@cache
def _names(path: Path) -> frozenset[str]:
    tokens = tokenize.generate_tokens(io.StringIO(path.read_text(encoding="utf-8")).readline)
    return frozenset(token.string for token in tokens if token.type == tokenize.NAME)


def test_no_public_class_is_named_twice() -> None:
    homes = defaultdict(list)
    for path in SOURCES:
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.ClassDef) and not node.name.startswith("_"):
                homes[node.name].append(path.relative_to(ROOT).as_posix())
    assert {name: places for name, places in homes.items() if len(places) > 1} == {}


@pytest.mark.parametrize("old", GIVEN_UP)
def test_a_name_that_was_given_up_is_in_no_source_and_on_no_page(old: str) -> None:
    found = {path.relative_to(ROOT).as_posix() for path in SOURCES if old in _names(path) or _is_a_value(old, path)}
    pages = {
        path.relative_to(ROOT).as_posix()
        for path in PAGES
        if re.search(rf"`[^`\n]*\b{old}\b[^`\n]*`", path.read_text(encoding="utf-8"))
    }
    assert {file for file in found | pages if (file, old) not in STILL_READ} - _documenting(old) == set(), GIVEN_UP[old]


@pytest.mark.parametrize("phrase", PHRASES)
def test_a_phrase_that_was_given_up_is_in_no_source_and_on_no_page(phrase: str) -> None:
    texts = {path: " ".join(path.read_text(encoding="utf-8").lower().split()) for path in (*SOURCES, *PAGES)}
    found = [path for path, text in texts.items() if phrase in text]
    assert found == []


@pytest.mark.parametrize("folder", GROUND)
def test_no_value_is_named_by_an_empty_noun(folder: str) -> None:
    sources = (path for path in SOURCES if path.relative_to(ROOT).parts[0] == folder)
    empty = {path.relative_to(ROOT).as_posix(): sorted(_names(path) & EMPTY_NOUNS) for path in sources}
    assert {file: names for file, names in empty.items() if names} == {}


def _is_a_value(old: str, path: Path) -> bool:
    return re.search(rf"[\"']{old}[\"']", path.read_text(encoding="utf-8")) is not None


def _documenting(old: str) -> set[str]:
    """The page that says which value of before is still accepted."""
    return {"docs/paths.md", "docs/redundancy.md"} if old == "faithful" else set()
