"""effective_config is for audit and replay: no fit reads a setting from it."""

from __future__ import annotations

import ast
from pathlib import Path

from tests.house.sources import SOURCES, name_of, nodes_of, text_of

NAME = "effective_config"
ALLOWED = {
    "recordings/manifest.py": "declares it",
    "station/files/replay.py": "replays with it",
    "station/live/replay.py": "replays with it",
    "station/manifest.py": "writes it",
}


def test_only_audit_and_replay_mention_the_configuration_that_was_in_force() -> None:
    mentioning = {name_of(path) for path in SOURCES if NAME in text_of(path) and _mentions(path)}
    assert mentioning == set(ALLOWED)


def _mentions(path: Path) -> bool:
    """Whether the code, beyond docstrings, uses the name as an attribute, a variable, a keyword or a key."""
    for node in nodes_of(path):
        used = {getattr(node, field, None) for field in ("attr", "id", "arg", "value") if _is_text(node, field)}
        if NAME in used:
            return True
    return False


def _is_text(node: ast.AST, field: str) -> bool:
    return isinstance(getattr(node, field, None), str)
