"""Figures of the source tree: python -m benchmarks.layout [FOLDER]

Prints files and lines per top-level folder, and the levels of imports between its parts. A part is a folder or a file
directly below the top-level folder; a part that imports no other part is on level 1.
"""

from __future__ import annotations

import ast
import statistics
import sys
from collections.abc import Iterator
from pathlib import Path

FOLDERS = ("cuffstation", "station", "drivers", "recordings", "fitting", "solver", "documents")


def main() -> None:
    root = Path(sys.argv[1]) if len(sys.argv) > 1 else Path(__file__).parents[1]
    print("| folder | files | median lines | longest file | longest function | parts | levels |")
    print("|---|---:|---:|---:|---:|---:|---:|")
    for folder in FOLDERS:
        print(_row(root, folder))


def _row(root: Path, folder: str) -> str:
    sources = [path for path in sorted((root / folder).rglob("*.py")) if path.stat().st_size]
    lines = [path.read_text(encoding="utf-8").count("\n") for path in sources]
    functions = [length for path in sources for length in _function_lengths(path)]
    levels = _levels(root, folder)
    highest = max(levels.values())
    figures = (len(sources), round(statistics.median(lines)), max(lines), max(functions, default=0), len(levels))
    shown = highest if highest <= len(levels) else "a cycle"
    return f"| {folder} | {' | '.join(map(str, figures))} | {shown} |"


def _function_lengths(path: Path) -> Iterator[int]:
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
            yield (node.end_lineno or node.lineno) - node.body[0].lineno + 1


def _levels(root: Path, folder: str) -> dict[str, int]:
    """Part → level by the imports at the top of its modules; in a cycle it exceeds the number of parts."""
    imports: dict[str, set[str]] = {}
    for path in (root / folder).rglob("*.py"):
        part = _part(path.relative_to(root / folder))
        if part != "__init__" or folder == "cuffstation":
            imports.setdefault(part, set()).update(_imported(path, folder) - {part})

    levels = dict.fromkeys(imports, 1)
    for _ in imports:
        levels = {
            part: 1 + max((levels[other] for other in imports[part] & set(imports)), default=0) for part in imports
        }
    return levels


def _part(path: Path) -> str:
    return path.parts[0].removesuffix(".py")


def _imported(path: Path, folder: str) -> set[str]:
    found = set()
    for node in ast.parse(path.read_text(encoding="utf-8")).body:
        names = [node.module or ""] if isinstance(node, ast.ImportFrom) else []
        names += [alias.name for alias in node.names] if isinstance(node, ast.Import) else []
        found |= {name.split(".")[1] for name in names if name.startswith(f"{folder}.")}
    return found


if __name__ == "__main__":
    main()
