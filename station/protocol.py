"""The measurement plan: cuffs, tests and repeats in the order of recording, and names that every system allows.

File names that Windows does not allow are refused everywhere, so that a session can move between systems.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path

from documents.message import Message
from recordings.manifest import Manifest, TestKind, TrialCondition
from station.messages.bench_messages import RefusalCode

CUFF_TESTS: tuple[TestKind, ...] = ("static", "dynamic")
SUITED: tuple[TrialCondition, ...] = ("slack", "tight")
"""Conditions in which the suit is worn."""
BODY_TESTS: tuple[TestKind, ...] = ("pose", "motion")
CONDITION_NAMES: dict[TrialCondition, str] = {
    "unsuited": "without the suit",
    "slack": "suit, cord slack",
    "tight": "suit, cord tight",
    "mvc": "maximal contraction",
}
LONGEST_PATH = 259
"""Characters, unless the administrator of the computer allows more."""
SUFFIX_LENGTH = 16
"""Characters that a recovery or a draft appends."""
FORBIDDEN = '<>:"/\\|?*'
RESERVED = {"CON", "PRN", "AUX", "NUL", *(f"{port}{digit}" for port in ("COM", "LPT") for digit in "123456789")}


@dataclass(frozen=True)
class TrialKey:
    """Identity of a trial of the plan: cuff, test, number of the repeat (from 1) and donning of the cuff.

    cuff: None for a bounce (a weight hangs from the load cell) and for a pose or motion of the wearer. condition: of a
    motion.
    """

    cuff: str | None
    test: TestKind
    repeat: int
    donning: str = "1"
    condition: TrialCondition | None = None


@dataclass(frozen=True)
class TrialSpec(TrialKey):
    """A trial of the plan with the template of its file name.

    In the name, the condition replaces the cuff where there is none; without either, its part is left out.
    """

    name: str = "cuff-{cuff}_test-{test}_run-{run}"

    @classmethod
    def of_recording(cls, manifest: Manifest) -> TrialSpec:
        """The trial that was recorded."""
        cuff = manifest.cuff.name if manifest.cuff else None
        return cls(cuff, manifest.test, manifest.repeat, manifest.donning, condition=manifest.condition)

    @property
    def title(self) -> str:
        """Title of the trial for the operator."""
        return describe_trial(self.cuff, self.test, self.repeat, self.condition)

    def file_name(self, run: int) -> str:
        label, parts = self.cuff or self.condition, self.name.split("_")
        if label is None:
            parts = [part for part in parts if "{cuff}" not in part or "{test}" in part or "{run}" in part]
        template = "_".join(parts)
        if self.cuff is None:
            template = template.replace("cuff-{cuff}", "condition-{cuff}")
        return template.format(cuff=label or self.test, test=self.test, run=run) + ".mcap"

    def next_free_run(self, session: Path) -> int:
        """The number of the repeat, or the next one without a file, so that no file is overwritten.

        Files of a recovery or an export with this number count as well.
        """
        run = self.repeat
        while any(session.glob(f"{Path(self.file_name(run)).stem}.*")):
            run += 1
        return run


def describe_trial(cuff: str | None, test: str, repeat: int, condition: TrialCondition | None = None) -> str:
    """Title for the operator: "hand, static, repeat 1", "motion, suit, cord tight" or "bounce calibration"."""
    if cuff is not None:
        return f"{cuff}, {test}, repeat {repeat}"
    if test == "bounce":
        return "bounce calibration"
    worn, again = CONDITION_NAMES[condition] if condition else "", f"repeat {repeat}" if repeat > 1 else ""
    return ", ".join(filter(None, (test, worn, again)))


def published_plan(
    cuffs: Iterable[str], repeats: int, *, has_bounce: bool = False, conditions: Iterable[TrialCondition] = ()
) -> Iterator[TrialSpec]:
    """`repeats` × (static, dynamic) of every cuff, donned once; before them one bounce.

    With conditions, a pose and the motions without the suit follow the bounce, and the motions in the suit follow the
    cuffs.
    """
    conditions = tuple(conditions)
    if has_bounce:
        yield TrialSpec(None, "bounce", 1)
    if conditions:
        yield TrialSpec(None, "pose", 1)
    yield from (
        TrialSpec(None, "motion", 1, condition=condition) for condition in conditions if condition not in SUITED
    )
    for cuff in cuffs:
        for repeat in range(1, repeats + 1):
            for test in CUFF_TESTS:
                yield TrialSpec(cuff, test, repeat)
    yield from (TrialSpec(None, "motion", 1, condition=condition) for condition in conditions if condition in SUITED)


def windows_name_fault(name: str) -> str:
    """Reason why Windows refuses this file name, as a clause; "" if it does not."""
    wrong = sorted({letter for letter in name if letter in FORBIDDEN or ord(letter) < 32})
    if wrong:
        return f"contains {' '.join(map(repr, wrong))}, which Windows does not allow in a file name"
    if name.partition(".")[0].rstrip(" ").upper() in RESERVED:
        return f"is {name.partition('.')[0]}, a device name on Windows"
    if name != name.rstrip(". "):
        return "ends in a dot or a space, which Windows removes"
    return ""


def check_path_length(path: Path) -> Message[RefusalCode] | None:
    """Refusal of a path that is too long for Windows; None if it is short enough."""
    excess = len(str(path.absolute())) + SUFFIX_LENGTH - LONGEST_PATH
    if excess <= 0:
        return None
    return Message(RefusalCode.PATH_TOO_LONG, {"path": str(path), "excess": excess, "longest": LONGEST_PATH})
