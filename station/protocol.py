"""The measurement plan: which cuffs, which tests, how many repeats, in the order they are done."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path

from recordings.manifest import TestKind

CUFF_TESTS: tuple[TestKind, ...] = ("static", "dynamic")


@dataclass(frozen=True)
class TrialSpec:
    """One trial of the plan: this cuff, this test, for the n-th time (from 1), in one donning of the cuff.

    cuff is None for a bounce: the weight then hangs from the load cell, and nobody wears anything.
    name is the template of the file's name; where there is no cuff its part is left out.
    """

    cuff: str | None
    test: TestKind
    repeat: int
    donning: str = "1"
    name: str = "cuff-{cuff}_test-{test}_run-{run}"

    @property
    def title(self) -> str:
        """For a person: which trial of its session this is."""
        return "bounce calibration" if self.cuff is None else f"{self.cuff} · {self.test} · repeat {self.repeat}"

    def file_name(self, run: int) -> str:
        parts = [part for part in self.name.split("_") if self.cuff is not None or "{cuff}" not in part]
        return "_".join(parts).format(cuff=self.cuff, test=self.test, run=run) + ".mcap"

    def next_free_run(self, session: Path) -> int:
        """The repeat's own number, or the next that no file has: nothing is overwritten.

        What counts is the number after run-, also in the files that a recovery or an export left beside it.
        """
        run = self.repeat
        while any(session.glob(f"{Path(self.file_name(run)).stem}.*")):
            run += 1
        return run


def published_plan(cuffs: Iterable[str], repeats: int, *, has_bounce: bool = False) -> Iterator[TrialSpec]:
    """Static, dynamic, `repeats` times over, cuff after cuff, each donned once; before all of it, one bounce."""
    if has_bounce:
        yield TrialSpec(None, "bounce", 1)
    for cuff in cuffs:
        for repeat in range(1, repeats + 1):
            for test in CUFF_TESTS:
                yield TrialSpec(cuff, test, repeat)
