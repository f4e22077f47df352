"""Every term of the glossary has one line, and its place in the code exists."""

from __future__ import annotations

import ast
import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
ROWS = [
    [cell.strip() for cell in line.strip().strip("|").split("|")]
    for line in (ROOT / "docs" / "glossary.md").read_text(encoding="utf-8").splitlines()
    if line.startswith("| ") and not line.startswith("| term")
]


def test_there_are_at_least_forty_terms_and_none_twice() -> None:
    terms = [row[0] for row in ROWS]
    assert len(terms) >= 40
    assert len(set(terms)) == len(terms)


@pytest.mark.parametrize("row", ROWS, ids=lambda row: row[0])
def test_the_place_of_a_term_exists(row: list[str]) -> None:
    _term, _symbol, _unit, meaning, place = row
    assert meaning
    named = re.fullmatch(r"`([\w/]+\.py)(?:::(\w+)(?:\.(\w+))?)?`", place)
    assert named is not None, place
    path, name, member = named.groups()
    scope = ast.parse((ROOT / path).read_text(encoding="utf-8")).body
    for wanted in filter(None, (name, member)):
        found = [node for node in scope if wanted in _names_of(node)]
        assert found, f"{path} defines no {wanted}"
        scope = getattr(found[0], "body", [])


def _names_of(node: ast.stmt) -> set[str]:
    if isinstance(node, ast.ClassDef | ast.FunctionDef):
        return {node.name}
    targets = node.targets if isinstance(node, ast.Assign) else [node.target] if isinstance(node, ast.AnnAssign) else []
    return {target.id for target in targets if isinstance(target, ast.Name)}
