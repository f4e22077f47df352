"""Run `station` as if no extra were installed: `python -m tests.house.small_install VERB ... [+ VERB ...]`.

`library SESSION` walks the public package instead.
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
    if sys.argv[1] == "library":
        walk_library(Path(sys.argv[2]))
    else:
        _run_verbs(sys.argv[1:])


def _run_verbs(words: Sequence[str]) -> None:
    """One after the other, up to the first that fails."""
    from station.cli import main as station

    ends = [place for place, word in enumerate(words) if word == "+"]
    for start, end in pairwise([-1, *ends, len(words)]):
        sys.argv = ["station", *words[start + 1 : end]]
        try:
            station()
        except SystemExit as ended:
            if ended.code:
                raise


if __name__ == "__main__":
    main()
