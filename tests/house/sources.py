"""The Python files of the project, each parsed once for all tests of the house."""

from __future__ import annotations

import ast
from functools import cache
from pathlib import Path

ROOT = Path(__file__).parents[2]
FOLDERS = ("cuffstation", "station", "drivers", "recordings", "fitting", "solver", "documents")
SOURCES = [path for folder in FOLDERS for path in sorted((ROOT / folder).rglob("*.py"))]


@cache
def text_of(path: Path) -> str:
    return path.read_text(encoding="utf-8")


@cache
def nodes_of(path: Path) -> tuple[ast.AST, ...]:
    """All nodes of the file's syntax tree."""
    return tuple(ast.walk(ast.parse(text_of(path))))


def name_of(path: Path) -> str:
    """Path in the project, with slashes."""
    return path.relative_to(ROOT).as_posix()
