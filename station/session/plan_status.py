"""Status of the plan of a session: trials that count, trials to come, and the next one.

It follows from the journal alone, so that an interrupted session resumes where it was.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

from recordings.manifest import TrialCondition
from station.config import StationConfig
from station.journal import Journal, Recorded, Setup
from station.protocol import BODY_TESTS, TrialSpec, published_plan

DONNING_S, DECISION_S, HANGING_S, CYCLE_S = 90.0, 20.0, 5.0, 4.0
"""Assumed durations: to don a cuff, to arm and decide, to hang or remove a weight, and of an arm cycle."""
PREPARATIONS: dict[TrialCondition, str] = {
    "unsuited": "Wearer without the suit, all markers on",
    "slack": "Don the suit, cord slack",
    "tight": "Tighten the cord of the suit",
    "mvc": "Fix the arm for a maximal voluntary contraction",
}


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


def plan_status(setup: Setup, journal: Journal, folder: Path) -> PlanStatus:
    """Recordings whose file is missing do not count, nor those of an earlier donning."""
    trials = tuple(
        replace(spec, donning=str(1 + journal.donnings.get(spec.cuff or "", 0)))
        for spec in published_plan(setup.cuffs, setup.repeats, has_bounce=setup.has_bounce, conditions=setup.conditions)
    )
    present = [trial for trial in journal.recorded if (folder / trial.file).is_file()]
    accepted = {
        (trial.cuff, trial.test, trial.condition, trial.repeat, trial.donning)
        for trial in present
        if trial.file in journal.verdicts and trial.file not in journal.redone
    }
    done = frozenset(
        spec for spec in trials if (spec.cuff, spec.test, spec.condition, spec.repeat, spec.donning) in accepted
    )
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


def minutes_left(plan: PlanStatus, config: StationConfig) -> int:
    """Estimate of the time for the trials that are left, from the durations of the protocol; at least 1."""
    seconds = sum(DECISION_S + _duration_s(spec, config) for spec in plan.left)
    cuffs = {spec.cuff for spec in plan.left if spec.cuff is not None}
    pauses = {(spec.cuff, spec.repeat) for spec in plan.left if spec.cuff is not None and spec.repeat > 1}
    return max(1, round((seconds + DONNING_S * len(cuffs) + config.protocol.pause_s * len(pauses)) / 60))


def _duration_s(spec: TrialSpec, config: StationConfig) -> float:
    if spec.test == "static":
        return (2 * len(config.protocol.step_masses_kg) + 1) * (config.protocol.hold_s + HANGING_S)
    if spec.test in BODY_TESTS and config.body is not None:
        return config.body.pose_s if spec.test == "pose" else config.body.cycles * CYCLE_S
    return config.protocol.swing_s


def preparation(plan: PlanStatus, config: StationConfig) -> str:
    """What to do at the bench before the next trial."""
    if plan.spec is None:
        return "The plan is complete"
    if plan.spec.cuff is None:
        return _preparation_without_cuff(plan.spec, config)
    if plan.is_new_cuff:
        return f"Don the {plan.spec.cuff} cuff, rope slack"
    if plan.is_back and plan.spec.cuff is not None:
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
