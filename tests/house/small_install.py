"""Run `station` as if no extra were installed: `python -m tests.house.small_install VERB ... [+ VERB ...]`.

`library SESSION` walks the public package. All verbs are run and have to end with the same exit code.
"""

import pkgutil
import sys
from collections.abc import Sequence
from importlib import import_module
from importlib.abc import MetaPathFinder
from importlib.machinery import ModuleSpec
from itertools import pairwise
from pathlib import Path
from types import ModuleType
from unittest.mock import patch

from station.extras import PACKAGES

BLOCKED = {package for packages in PACKAGES.values() for package in packages}
OF_FORMATS = {f"recordings.exchange.{name}" for name in ("foxglove", "parquet")}


class Blocker(MetaPathFinder):
    """Refuses to import the extras' packages, before any other finder is asked."""

    def find_spec(self, name: str, path: Sequence[str] | None, target: ModuleType | None = None) -> ModuleSpec | None:
        if name.split(".", maxsplit=1)[0] in BLOCKED:
            raise ModuleNotFoundError(f"No module named {name!r}", name=name)
        return None


def walk_library(session: Path) -> None:
    """What README's Python lines do, and every module an analyst can import."""
    import cuffstation as cs

    for room in ("documents", "recordings", "fitting", "solver"):
        for module in pkgutil.walk_packages([room], f"{room}."):
            if module.name not in OF_FORMATS:
                import_module(module.name)
    fitted = cs.fit_session(session)
    print(fitted.to_dataframe())
    cs.write_cuffs(session.parent / "written.json", fitted.cuffs)
    cs.read_cuffs(session.parent / "written.json")
    cs.plot(fitted)
    print(cs.read_recording(next(session.glob("*.mcap"))).load("/force").to_dataframe())
    model = cs.load_model()
    print(cs.solve_motion(model, cs.load_motion(model, every=400)))


def main() -> None:
    loaded = {name.split(".")[0] for name in sys.modules} & BLOCKED
    assert not loaded, loaded
    sys.meta_path.insert(0, Blocker())
    ends = [place for place, word in enumerate(sys.argv) if word == "+"]
    codes = {_run(sys.argv[start + 1 : end]) for start, end in pairwise([0, *ends, len(sys.argv)])}
    assert len(codes) == 1, codes
    sys.exit(codes.pop())


def _run(words: Sequence[str]) -> int:
    """Exit code of the verb."""
    from station.cli import main as station

    if words[0] == "library":
        walk_library(Path(words[1]))
        return 0
    with patch("sys.argv", ["station", *words]):
        try:
            station()
        except SystemExit as ended:
            return int(ended.code or 0)


if __name__ == "__main__":
    main()
