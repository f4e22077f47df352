"""The cut-file matrix of docs/reliability.md: cut and damaged recordings, and what is recovered from them.

    python -m benchmarks.recovery [SHARE]

Takes an hour or two, the shorter rows first; a SHARE of 0.1 tries every tenth. Each recovery must keep exactly the
messages of the complete chunks, open by its index in the mcap package with correct CRCs, be the same when repeated, and
leave the original unchanged. A file without a complete chunk must be refused in one line. The first failure ends the
run.
"""

from __future__ import annotations

import sys
import tempfile
import time
from collections.abc import Callable, Iterable
from pathlib import Path

import numpy as np

from tests.recordings.cutting import Victim, record_boundaries, whole_file


def main(share: float) -> None:
    print("| recording | damage | tried | recovered | refused | time of a recovery |")
    print("|---|---|---:|---:|---:|---:|")
    every, random = round(1 / share), np.random.default_rng(6)
    with tempfile.TemporaryDirectory() as folder:
        short = Victim(whole_file(Path(folder), 3.7), Path(folder))
        long = Victim(whole_file(Path(folder), 60.0), Path(folder))
        size = len(short.data)
        around = [place + step for place in record_boundaries(short.data) for step in (-1, 0, 1)]
        bits = random.integers(0, 8 * size, 2000).tolist()
        cuts = random.integers(0, len(long.data) + 1, 2000).tolist()
        _try(
            short,
            "cut at every record ± 1 byte",
            [a for a in around[::every] if 0 <= a <= size],
            short.ensure_cut_is_recovered,
        )
        _try(short, "one random bit flipped", bits[::every], short.ensure_flip_is_recovered)
        _try(long, "cut at random", cuts[::every], long.ensure_cut_is_recovered)
        _try(short, "cut at every byte", range(0, size + 1, every), short.ensure_cut_is_recovered)


def _try(victim: Victim, what: str, places: Iterable[int], ensure: Callable[[int], None]) -> None:
    victim.kept.clear()
    began_s, tried = time.monotonic(), 0
    for place in places:
        ensure(place)
        tried += 1
    took_ms = 1000 * (time.monotonic() - began_s) / tried
    seconds = victim.whole.stem.removeprefix("whole-")
    cells = (
        f"{seconds} s, {len(victim.data):,} bytes",
        what,
        tried,
        len(victim.kept),
        tried - len(victim.kept),
        f"{took_ms:.0f} ms",
    )
    print(f"| {' | '.join(map(str, cells))} |", flush=True)


if __name__ == "__main__":
    main(float(sys.argv[1]) if len(sys.argv) > 1 else 1.0)
