"""The Python files of the project, each parsed once for all tests of the house, and Python in a process of its own."""

import ast
import gc
import os
import subprocess
import sys
from functools import cache
from pathlib import Path

from tests.timeout import scaled_timeout

ROOT = Path(__file__).parents[2]
FOLDERS = ("cuffstation", "station", "drivers", "recordings", "fitting", "solver", "documents")
SOURCES = [path for folder in FOLDERS for path in sorted((ROOT / folder).rglob("*.py"))]


@cache
def text_of(path: Path) -> str:
    return path.read_text(encoding="utf-8")


@cache
def nodes_of(path: Path) -> tuple[ast.AST, ...]:
    """All nodes of the file's syntax tree. They stay to the end: garbage collection is kept from them."""
    gc.collect()  # what is garbage already is not to stay
    gc.disable()
    try:
        return tuple(ast.walk(ast.parse(text_of(path))))
    finally:
        gc.freeze()
        gc.enable()


def name_of(path: Path) -> str:
    """Path in the project, with slashes."""
    return path.relative_to(ROOT).as_posix()


def run_python(
    *words: object, folder: Path = ROOT, program: str = sys.executable, patience_s: float = 280.0, **variables: str
) -> subprocess.CompletedProcess[str]:
    """Run Python, or another program, with these words and variables of the environment, in the folder."""
    return subprocess.run(  # noqa: S603  (our own words)
        [program, *map(str, words)],
        cwd=folder,
        capture_output=True,
        text=True,
        check=False,
        timeout=scaled_timeout(patience_s),
        env={**os.environ, **variables},
    )
