"""The measurement plan: which cuffs, which tests, how many repeats, in the order they are done."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path

from recordings.manifest import TestKind

TESTS: tuple[TestKind, ...] = ("static", "dynamic")


@dataclass(frozen=True)
class TrialSpec:
    """One trial of the plan: this cuff, this test, for the n-th time (from 1), in one donning of the cuff."""

    cuff: str
    test: TestKind
    repeat: int
    donning: str = "1"

    def file_name(self, run: int) -> str:
        return f"cuff-{self.cuff}_test-{self.test}_run-{run}.mcap"

    def next_free_run(self, session: Path) -> int:
        """The repeat's own number, or the next that no file has: nothing is overwritten.

        What counts is the number after run-, also in the files that a recovery or an export left beside it.
        """
        run = self.repeat
        while any(session.glob(f"{Path(self.file_name(run)).stem}.*")):
            run += 1
        return run


def published_plan(cuffs: Iterable[str], repeats: int) -> Iterator[TrialSpec]:
    """Static, dynamic, `repeats` times over, cuff after cuff, each donned once."""
    for cuff in cuffs:
        for repeat in range(1, repeats + 1):
            for test in TESTS:
                yield TrialSpec(cuff, test, repeat)
