"""What comes next in a session: the plan, less what counts already. The journal alone decides, so a session that was
interrupted goes on where it was."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

from station.journal import Journal, Recorded, Setup
from station.protocol import TrialSpec, published_plan


@dataclass(frozen=True)
class Agenda:
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


def agenda(setup: Setup, journal: Journal, folder: Path) -> Agenda:
    """Where a session stands. A recording whose file is gone does not count, nor one of an earlier donning."""
    trials = tuple(
        replace(spec, donning=str(1 + journal.donnings.get(spec.cuff or "", 0)))
        for spec in published_plan(setup.cuffs, setup.repeats, has_bounce=setup.has_bounce)
    )
    there = [each for each in journal.recorded if (folder / each.file).is_file()]
    accepted = {
        (each.cuff, each.test, each.repeat, each.donning)
        for each in there
        if each.file in journal.verdicts and each.file not in journal.redone
    }
    done = frozenset(spec for spec in trials if (spec.cuff, spec.test, spec.repeat, spec.donning) in accepted)
    skipped = journal.skipped.difference(done).intersection(trials)
    spec = next((spec for spec in trials if spec not in done | skipped), None)
    before = None if spec is None or spec == trials[0] else trials[trials.index(spec) - 1]
    return Agenda(
        trials=trials,
        done=done,
        skipped=skipped,
        undecided=next((each for each in there if each.file not in journal.verdicts), None),
        spec=spec,
        is_new_cuff=spec is not None
        and spec.cuff is not None
        and not any((each.cuff, each.donning) == (spec.cuff, spec.donning) for each in there),
        has_pause=spec is not None and before is not None and before.cuff == spec.cuff and before.repeat != spec.repeat,
    )


def order_of(plan: Agenda, pause_s: float) -> str:
    """What to do at the bench before the next trial."""
    if plan.spec is None:
        return "The plan is complete"
    if plan.spec.cuff is None:
        return "Hang the calibration weight on its spring under the load cell"
    if plan.is_new_cuff:
        return f"Don the {plan.spec.cuff} cuff, rope slack"
    if plan.has_pause:
        return f"Let the wearer rest for {pause_s:.0f} s"
    return "Rope slack, wearer at ease"


def redo_loses_migration(recorded: Recorded, journal: Journal) -> bool:
    """Whether the donning's migration stays unknown if this recording is redone without donning the cuff anew.

    The cuff may have migrated in it, and migration counts from the first static trial of a donning.
    """
    static = [
        trial.file
        for trial in journal.recorded
        if (trial.cuff, trial.test, trial.donning) == (recorded.cuff, "static", recorded.donning)
    ]
    return recorded.cuff is not None and static[:1] == [recorded.file]


def donning_is_open(recorded: Recorded, journal: Journal) -> bool:
    """Whether the cuff was donned anew after this recording was redone, and nothing was recorded on it since."""
    if recorded.cuff is None or journal.verdicts[recorded.file].choice != "redo":
        return False
    donned = journal.donnings.get(recorded.cuff, 0)
    later = [trial for trial in journal.recorded if (trial.cuff, trial.donning) == (recorded.cuff, str(1 + donned))]
    return recorded.donning == str(donned) and not later
