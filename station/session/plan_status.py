"""Status of the plan of a session: trials that count, trials to come, and the next one.

It follows from the journal alone, so that an interrupted session resumes where it was.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

from recordings.manifest import TrialCondition
from station.config import StationConfig
from station.journal import Journal, Recorded, Setup
from station.protocol import TrialSpec, published_plan

PREPARATIONS: dict[TrialCondition, str] = {
    "unsuited": "Wearer without the suit, all markers on",
    "slack": "Don the suit, cord slack",
    "tight": "Tighten the cord of the suit",
    "mvc": "Fix the arm for a maximal voluntary contraction",
}


@dataclass(frozen=True)
class PlanStatus:
    """trials are all of the plan, in order; done are those with an accepted recording; skipped are not recorded.

    undecided is the recording that waits for accept or redo; spec is the next trial, None at the end of the plan.
    is_new_cuff: its cuff has to be donned first; has_pause: the wearer rests first, between two repeats on one cuff.
    """

    trials: tuple[TrialSpec, ...]
    done: frozenset[TrialSpec]
    skipped: frozenset[TrialSpec]
    undecided: Recorded | None
    spec: TrialSpec | None
    is_new_cuff: bool
    has_pause: bool


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
    spec = next((spec for spec in trials if spec not in done | skipped), None)
    before = None if spec is None or spec == trials[0] else trials[trials.index(spec) - 1]
    return PlanStatus(
        trials=trials,
        done=done,
        skipped=skipped,
        undecided=next((trial for trial in present if trial.file not in journal.verdicts), None),
        spec=spec,
        is_new_cuff=spec is not None
        and spec.cuff is not None
        and not any((trial.cuff, trial.donning) == (spec.cuff, spec.donning) for trial in present),
        has_pause=spec is not None and before is not None and before.cuff == spec.cuff and before.repeat != spec.repeat,
    )


def preparation(plan: PlanStatus, config: StationConfig) -> str:
    """What to do at the bench before the next trial."""
    if plan.spec is None:
        return "The plan is complete"
    if plan.spec.cuff is None:
        return _preparation_without_cuff(plan.spec, config)
    if plan.is_new_cuff:
        return f"Don the {plan.spec.cuff} cuff, rope slack"
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
