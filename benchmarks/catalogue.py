"""Time to index sessions, and to add one: `python -m benchmarks.catalogue [--sessions N]`.

The sessions are synthetic: session.jsonl and cuffs.json with the donnings and trials of two cuffs. With --like FILE
every session has that cuffs.json instead, as of a fitted session of a bench.
"""

from __future__ import annotations

import argparse
import shutil
import tempfile
from pathlib import Path
from time import perf_counter, process_time

from station.catalogue.index import CATALOGUE_FILE, update_catalogue
from tests.station.study.synthetic_sessions import write_sessions


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--sessions", type=int, default=1000)
    parser.add_argument("--like", type=Path)
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name) / "sessions"
        written = write_sessions(folder, options.sessions, operators=1, donnings=3, repeats=3)
        for session in written if options.like else ():
            shutil.copy(options.like, session / "cuffs.json")
        path = folder / CATALOGUE_FILE
        _timed(f"{options.sessions} sessions", folder, path)
        shutil.copytree(written[0], folder / "added")
        _timed("one added", folder, path)
        _timed("nothing new", folder, path)
        print(f"{path.stat().st_size / 1e6:.1f} MB")


def _timed(what: str, folder: Path, path: Path) -> None:
    begun, used = perf_counter(), process_time()
    indexed = update_catalogue(folder, path)
    elapsed, processor = perf_counter() - begun, process_time() - used
    print(f"{what:16} {elapsed:6.2f} s, {processor:6.2f} s of processor, {indexed.read} read")


if __name__ == "__main__":
    main()
