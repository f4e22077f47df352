"""Status of the plan of a session: trials that count, trials to come, and the next one; and a check of its set-up.

It follows from the journal alone, so that an interrupted session resumes where it was.
"""

from __future__ import annotations

import math
import re
from dataclasses import dataclass, replace
from datetime import datetime
from itertools import pairwise
from pathlib import Path
from typing import Literal

from documents.interval import counted
from documents.message import Message
from recordings.manifest import TrialCondition
from station.config import StationConfig
from station.journal import MOST_REPEATS, Journal, Recorded, Setup
from station.messages.session_messages import CommandCode
from station.protocol import BODY_TESTS, TrialSpec, published_plan

DONNING_S, DECISION_S, HANGING_S, CYCLE_S = 90.0, 20.0, 5.0, 4.0
"""Assumed durations: to don a cuff, to arm and decide, to hang or remove a weight, and of an arm cycle."""
ASSUMED_S = 300.0
"""The assumed durations count as much as this time of the session itself."""
INTERRUPTION = 4.0
"""A trial that takes this multiple of its expected time, or longer, was interrupted and shows no pace."""
PlanState = Literal["kept", "skipped", "next", "to come"]
"""Of a trial of the plan."""
PREPARATIONS: dict[TrialCondition, str] = {
    "unsuited": "Wearer without the suit, all markers on",
    "slack": "Don the suit, cord slack",
    "tight": "Tighten the cord of the suit",
    "mvc": "Fix the arm for a maximal voluntary contraction",
}
SUBJECT = re.compile(r"[A-Za-z0-9]{1,32}")
NAME = re.compile(r"\D*[^\W\d_]{3}\D*")


@dataclass(frozen=True)
class PlanStatus:
    """trials are all of the plan, in order; done are those with an accepted recording; skipped are not recorded.

    left are the others in the order of recording, in which a chosen one is the first; spec is the first of them.
    undecided is the recording that waits for accept or redo.
    is_new_cuff: its cuff has to be donned first; is_back: another cuff was pulled meanwhile; has_pause: the wearer
    rests first, between two repeats on one cuff.
    """

    trials: tuple[TrialSpec, ...]
    done: frozenset[TrialSpec]
    skipped: frozenset[TrialSpec]
    left: tuple[TrialSpec, ...]
    undecided: Recorded | None
    is_new_cuff: bool
    is_back: bool
    has_pause: bool

    @property
    def spec(self) -> TrialSpec | None:
        """The next trial; None at the end of the plan."""
        return self.left[0] if self.left else None

    def trial_state(self, trial: TrialSpec) -> PlanState:
        if trial in self.done:
            return "kept"
        if trial in self.skipped:
            return "skipped"
        return "next" if trial == self.spec else "to come"


def plan_status(setup: Setup, journal: Journal, folder: Path) -> PlanStatus:
    """Recordings whose file is missing do not count, nor those of an earlier donning."""
    trials = tuple(
        replace(spec, donning=str(1 + journal.donnings.get(spec.cuff or "", 0)))
        for spec in published_plan(setup.cuffs, setup.repeats, has_bounce=setup.has_bounce, conditions=setup.conditions)
    )
    present = [trial for trial in journal.recorded if (folder / trial.file).is_file()]
    accepted = {_place(trial) for trial in present if _is_kept(trial, journal)}
    done = frozenset(spec for spec in trials if _place(spec) in accepted)
    skipped = journal.skipped.difference(done).intersection(trials)
    left = [spec for spec in trials if spec not in done | skipped]
    left.sort(key=lambda spec: journal.chosen.index(spec) if spec in journal.chosen else len(journal.chosen))
    spec = left[0] if left else None
    before = None if spec is None or spec == trials[0] else trials[trials.index(spec) - 1]
    of_cuff = [trial for trial in present if spec and trial.cuff == spec.cuff and trial.donning == spec.donning]
    return PlanStatus(
        trials=trials,
        done=done,
        skipped=skipped,
        left=tuple(left),
        undecided=next((trial for trial in present if trial.file not in journal.verdicts), None),
        is_new_cuff=spec is not None and spec.cuff is not None and not of_cuff,
        is_back=bool(of_cuff) and present[-1] is not of_cuff[-1],
        has_pause=spec is not None and before is not None and before.cuff == spec.cuff and before.repeat != spec.repeat,
    )


def kept_recordings(spec: TrialSpec, journal: Journal) -> list[Recorded]:
    """The accepted recordings of a trial of the plan."""
    return [trial for trial in journal.recorded if _place(trial) == _place(spec) and _is_kept(trial, journal)]


def _place(trial: TrialSpec | Recorded) -> tuple[object, ...]:
    """Place in the plan."""
    return trial.cuff, trial.test, trial.condition, trial.repeat, trial.donning


def _is_kept(trial: Recorded, journal: Journal) -> bool:
    return trial.file in journal.verdicts and trial.file not in journal.redone


def minutes_left(plan: PlanStatus, journal: Journal, config: StationConfig) -> int:
    """Estimate of the time for the trials that are left, at the pace of the session so far; at least 1."""
    last = journal.recorded[-1] if journal.recorded else None
    expected_s = sum(_expected_s(spec, before, config) for before, spec in pairwise((last, *plan.left)) if spec)
    return max(1, round(_pace(journal, config) * expected_s / 60))


def _pace(journal: Journal, config: StationConfig) -> float:
    """Duration of the trials so far, relative to the expected one."""
    expected_s = taken_s = ASSUMED_S
    for before, trial in pairwise(journal.recorded):
        trial_s = _expected_s(trial, before, config)
        passed_s = _seconds_between(journal.entered.get(before.file, ""), journal.entered.get(trial.file, ""))
        if 0 < passed_s < INTERRUPTION * trial_s:
            expected_s, taken_s = expected_s + trial_s, taken_s + passed_s
    return taken_s / expected_s


def _expected_s(trial: TrialSpec | Recorded, before: TrialSpec | Recorded | None, config: StationConfig) -> float:
    """Time from the end of the trial before to the end of this one: donning or rest, the trial, and its decision."""
    seconds = DECISION_S + _duration_s(trial, config)
    if trial.cuff is None:
        return seconds
    if before is None or (before.cuff, before.donning) != (trial.cuff, trial.donning):
        return seconds + DONNING_S
    return seconds + (config.protocol.pause_s if before.repeat != trial.repeat else 0.0)


def _seconds_between(first: str, second: str) -> float:
    """Of two times of the journal; 0 for one that cannot be read."""
    try:
        return (datetime.fromisoformat(second) - datetime.fromisoformat(first)).total_seconds()
    except (ValueError, TypeError):  # TypeError: only one of them has a time zone
        return 0.0


def _duration_s(trial: TrialSpec | Recorded, config: StationConfig) -> float:
    if trial.test == "static":
        return (2 * len(config.protocol.step_masses_kg) + 1) * (config.protocol.hold_s + HANGING_S)
    if trial.test in BODY_TESTS and config.body is not None:
        return config.body.pose_s if trial.test == "pose" else config.body.cycles * CYCLE_S
    return config.protocol.swing_s


def preparation(plan: PlanStatus, config: StationConfig) -> str:
    """Instruction for the bench before the next trial."""
    if plan.spec is None:
        return "The plan is complete"
    if plan.spec.cuff is None:
        return _preparation_without_cuff(plan.spec, config)
    if plan.is_new_cuff:
        return f"Don the {plan.spec.cuff} cuff, rope slack"
    if plan.is_back:
        return f"Rope to the {plan.spec.cuff} cuff, worn as before, and slack"
    if plan.has_pause:
        return f"Let the wearer rest for {config.protocol.pause_s:.0f} s"
    return "Rope slack, wearer at ease"


def _preparation_without_cuff(spec: TrialSpec, config: StationConfig) -> str:
    if spec.test == "pose":
        return "Wearer without the suit, all markers on: stand upright, arm hanging"
    if spec.condition is not None:
        return f"{PREPARATIONS[spec.condition]}; wearer at ease, arm hanging"
    mass = f"{config.bounce.mass_kg:g} kg " if config.bounce is not None else ""
    return f"Hang the {mass}calibration weight on its spring under the load cell"


def redo_loses_migration(recorded: Recorded, journal: Journal) -> bool:
    """Whether the migration of the donning stays unknown if this trial is repeated without donning the cuff anew.

    The cuff may have migrated in it, and migration is measured from the first static trial of a donning.
    """
    static = [
        trial.file
        for trial in journal.recorded
        if (trial.cuff, trial.test, trial.donning) == (recorded.cuff, "static", recorded.donning)
    ]
    return recorded.cuff is not None and static[:1] == [recorded.file]


def is_donned_without_trial(recorded: Recorded, journal: Journal) -> bool:
    """Whether the cuff was donned anew with the decision on this recording, and no trial of it was recorded since."""
    if recorded.cuff is None or journal.verdicts[recorded.file].choice != "redo":
        return False
    donned = journal.donnings.get(recorded.cuff, 0)
    later = [trial for trial in journal.recorded if (trial.cuff, trial.donning) == (recorded.cuff, str(1 + donned))]
    return recorded.donning == str(donned) and not later


def looks_like_a_name(subject: str) -> bool:
    """Three letters in a row and no digit, as in Maria or de Vries; a code has a digit in it."""
    return NAME.fullmatch(subject.strip()) is not None


def is_subject_code(subject: str) -> bool:
    """Whether it can be part of file names."""
    return SUBJECT.fullmatch(subject) is not None


def check_setup(setup: Setup, config: StationConfig) -> Message[CommandCode] | None:
    """The first fault of a set-up; None if there is none."""
    if not setup.subject:
        return Message(CommandCode.NO_SUBJECT)
    if not is_subject_code(setup.subject):
        return Message(CommandCode.WRONG_SUBJECT, {"subject": repr(setup.subject)})
    if not SUBJECT.fullmatch(setup.number):
        return Message(CommandCode.WRONG_NUMBER, {"number": repr(setup.number)})
    if not 1 <= setup.repeats <= MOST_REPEATS:
        return Message(CommandCode.WRONG_REPEATS, {"repeats": setup.repeats, "most": MOST_REPEATS})
    if not all(0 < mass < math.inf for mass in setup.step_masses_kg):
        return Message(CommandCode.WRONG_MASSES, {"masses": str(setup.step_masses_kg)})
    return _check_subjects(setup, config)


def _check_subjects(setup: Setup, config: StationConfig) -> Message[CommandCode] | None:
    """The first fault of the cuffs and of the wearer's trials; a session of the wearer's trials alone needs no cuff."""
    known = ", ".join(config.cuffs)
    if not setup.cuffs and not setup.conditions:
        return Message(CommandCode.NO_CUFF_CHOSEN, {"known": known})
    unknown = [cuff for cuff in setup.cuffs if cuff not in config.cuffs]
    if unknown:
        return Message(CommandCode.UNKNOWN_CUFF, {"unknown": ", ".join(unknown), "known": known})
    repeated = [cuff for cuff in dict.fromkeys(setup.cuffs) if setup.cuffs.count(cuff) > 1]
    if repeated:
        return Message(CommandCode.REPEATED_CUFF, {"repeated": ", ".join(repeated)})
    return Message(CommandCode.NO_BODY) if setup.conditions and config.body is None else None


def load_steps(setup: Setup, config: StationConfig) -> tuple[float, ...]:
    """The load steps of the session [kg]; those of the configuration if the set-up has none."""
    return setup.step_masses_kg or config.protocol.step_masses_kg


def describe_plan(setup: Setup, config: StationConfig) -> str:
    """Cuffs, repeats, load steps and motions of a session, on one line."""
    parts = [f"motions {', '.join(setup.conditions)}"] if setup.conditions else []
    if setup.cuffs:
        masses = " + ".join(f"{mass:g}" for mass in load_steps(setup, config))
        repeats = counted(setup.repeats, "repeat")
        parts.insert(
            0, f"{repeats} of {', '.join(setup.cuffs)}" + (f" with load steps of {masses} kg" if masses else "")
        )
    return ", ".join(parts)
