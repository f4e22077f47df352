"""Size of the source tree, concepts declared more than once, and files entered by three flows.

    python -m benchmarks.house [SESSION] [--list]

Prints files and lines of every top-level folder, the number of modules with sentences, pairs of a dataclass and a
pydantic model that mirror each other, with each class in one pair, the same of classes with any base in any number of
pairs, which is the stricter count, and file names that occur more than once. With the folder of a session, as
`simulated/demo`, also the files whose functions run during a fit of two recordings, an assessment of three frames and
one live frame with and without the suit, and with `--list` their names. `__init__.py` is not counted.
"""

import ast
import sys
from collections import Counter
from collections.abc import Callable, Iterator
from itertools import product
from pathlib import Path
from types import FrameType
from typing import Any

from benchmarks.command_line import parse_options

ROOT = Path(__file__).parents[1]
PRODUCT = ("cuffstation", "station", "drivers", "recordings", "fitting", "solver", "documents")
ALIKE = 0.6
"""Shared fields over all fields from which a dataclass and a model mirror each other."""
LEAST_FIELDS = 3
FRAMES_APART = 300
"""Of the bundled motion, so that three are assessed."""
LEAST_WORDS, LEAST_SENTENCES = 4, 3
"""A file with this many dictionary values or enumeration members of this many words has sentences."""


def main() -> None:
    options = parse_options(__doc__, paths="*", list=False)
    sources = {folder: _sources(folder) for folder in (*PRODUCT, "benchmarks", "tests")}
    print("| folder | files | lines |\n|---|---:|---:|")
    for folder, paths in sources.items():
        print(f"| {folder} | {len(paths)} | {_lines(paths)} |")
    ours = [path for folder in PRODUCT for path in sources[folder]]
    print(f"| product | {len(ours)} | {_lines(ours)} |\n")
    print(f"files with sentences: {sum(map(_has_sentences, ours))}")
    of_models, of_any = _mirrored(ours)
    print(f"pairs of a dataclass and a model that mirror each other: {of_models}; classes with any base: {of_any}")
    repeated = {name: count for name, count in Counter(path.name for path in ours).items() if count > 1}
    print(f"file names that occur more than once: {len(repeated)}")
    for name, flow in _flows(options.paths[0]) if options.paths else ():
        entered = sorted(_entered(flow))
        print(f"files entered by {name}: {len(entered)}", *entered if options.list else (), sep="\n    ")


def _sources(folder: str) -> list[Path]:
    return [path for path in sorted((ROOT / folder).rglob("*.py")) if path.name != "__init__.py"]


def _lines(paths: list[Path]) -> int:
    return sum(path.read_text(encoding="utf-8").count("\n") for path in paths)


def _has_sentences(path: Path) -> bool:
    texts = [value for node in ast.walk(_tree(path)) for value in _values(node)]
    return sum(len(text.split()) >= LEAST_WORDS for text in texts) >= LEAST_SENTENCES


def _values(node: ast.AST) -> Iterator[str]:
    """Texts that are values of a dictionary keyed by attributes, or of the members of an enumeration."""
    if isinstance(node, ast.Dict):
        values: list[ast.expr] = [
            value for key, value in zip(node.keys, node.values, strict=True) if isinstance(key, ast.Attribute)
        ]
    elif isinstance(node, ast.ClassDef) and any(ast.unparse(base).endswith(("Enum", "Code")) for base in node.bases):
        values = [member for line in node.body if isinstance(line, ast.Assign) for member in ast.walk(line.value)]  # type: ignore[misc]
    else:
        return
    yield from (value.value for value in values if isinstance(value, ast.Constant) and isinstance(value.value, str))


def _mirrored(paths: list[Path]) -> tuple[int, int]:
    """Number of pairs of a dataclass and a model that share at least ALIKE of their fields, the most alike first, each
    class in one pair; and of all pairs of a dataclass and a class with any base that do.
    """
    classes = [node for path in paths for node in ast.walk(_tree(path)) if isinstance(node, ast.ClassDef)]
    fields = {node.name: _fields(node) for node in classes if len(_fields(node)) >= LEAST_FIELDS}
    dataclasses = {node.name for node in classes if any("dataclass" in ast.unparse(d) for d in node.decorator_list)}
    others = {node.name for node in classes if node.bases} - dataclasses
    shares = {
        (mirrored, other): len(fields[mirrored] & fields[other]) / len(fields[mirrored] | fields[other])
        for mirrored, other in product(sorted(dataclasses & set(fields)), sorted(others & set(fields)))
    }
    alike = sorted((pair for pair in shares if shares[pair] >= ALIKE), key=lambda pair: -shares[pair])
    models, paired = _models(classes), set[str]()
    for pair in alike:
        if pair[1] in models and not paired & set(pair):
            paired |= set(pair)
    return len(paired) // 2, len(alike)


def _models(classes: list[ast.ClassDef]) -> set[str]:
    """Names of the classes that derive from pydantic's BaseModel, through classes of the product or at once."""
    models = {"BaseModel"}
    while found := {node.name for node in classes if models & set(map(ast.unparse, node.bases))} - models:
        models |= found
    return models


def _fields(node: ast.ClassDef) -> set[str]:
    targets = [line.target for line in node.body if isinstance(line, ast.AnnAssign)]
    return {target.id for target in targets if isinstance(target, ast.Name)}


def _tree(path: Path) -> ast.Module:
    return ast.parse(path.read_text(encoding="utf-8"))


def _flows(session: Path) -> Iterator[tuple[str, Callable[[], Any]]]:
    """Names of the flows and functions that run them. What they import is loaded before."""
    import cuffstation as cs
    from solver.bundled import bundled_model, simulate_arm_raise
    from solver.motion import differentiate
    from solver.redundancy.motion_solution import LoadedMotion
    from solver.suit.assessment import assess
    from tests.solver.stream.streams import ARM, INTERVAL, SUIT, WORN, seen, solver

    pulls = [session / f"cuff-hand_test-{test}_run-1.mcap" for test in ("static", "dynamic")]
    yield "a fit of two recordings", lambda: cs.fit_donning(pulls)
    motion = LoadedMotion(bundled_model(), differentiate(simulate_arm_raise(bundled_model())))
    yield "an assessment of three frames", lambda: assess(motion, SUIT, [ARM], every=FRAMES_APART)
    stream, frames = solver({"bare": None, "worn": WORN}, lag_s=0.0), iter(enumerate(seen()))

    def push() -> None:
        frame, positions = next(frames)
        stream.push(frame * INTERVAL, positions)

    yield "one live frame", push


def _entered(flow: Callable[[], Any]) -> set[str]:
    """Files of the product whose functions are called."""
    entered: set[str] = set()

    def note(frame: FrameType, event: str, _argument: Any) -> None:
        if event == "call":
            entered.add(frame.f_code.co_filename)

    flow()  # the first call imports and compiles
    sys.setprofile(note)
    try:
        flow()
    finally:
        sys.setprofile(None)
    ours = [path.relative_to(ROOT) for path in map(Path, entered) if path.is_relative_to(ROOT)]
    return {str(path) for path in ours if path.parts[0] in PRODUCT and path.name != "__init__.py"}


if __name__ == "__main__":
    main()
