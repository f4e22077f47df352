"""A session as it was recorded, fitted, assessed with a short motion and few people, and reported."""

from __future__ import annotations

import json
from pathlib import Path

from station.assessment.budget_file import read_budget
from station.assessment.people_run import PeopleRun, SourceChoice
from station.checksums import write_checksums
from tests.station.foreign import static_and_dynamic

STATIC, DYNAMIC = (f"cuff-hand_test-{test}_run-1.mcap" for test in ("static", "dynamic"))


def report_session(folder: Path, people: int = 0) -> Path:
    """Two trials of one cuff from an independent experiment, with their results, in a new folder `session` below."""
    from station.assessment.assess import assess_cuffs, write_assessment
    from station.assessment.assessment_inputs import AssessmentInputs
    from station.fit import fit_session_folder
    from station.report.page import write_report

    folder /= "session"
    folder.mkdir(parents=True)
    for truth, file in zip(static_and_dynamic(), (STATIC, DYNAMIC), strict=True):
        truth.record(folder / file)
    true = {"hand": {"stiffness_n_per_m": 4000.0, "damping_n_s_per_m": 100.0, "migration_m": 0.01}}
    (folder / "simulated_truth.json").write_text(json.dumps(true))
    write_checksums(folder / STATIC, folder / DYNAMIC)  # as the recorder does when a trial ends
    fitted = fit_session_folder(folder, folder / "cuffs.json")
    inputs = AssessmentInputs(folder / "cuffs.json")
    worn = {name: fit.wearable() for name, fit in fitted.cuffs.items()}
    run = few_people(people) if people else None
    write_assessment(assess_cuffs(worn, inputs, most_frames=4, most_rest_lengths=5, people=run), folder)
    write_report(folder, fitted)
    return folder


def few_people(count: int, frames: int = 4, sources: SourceChoice = "all") -> PeopleRun:
    """A run with the bundled sources and so many people, each in about so many frames."""
    budget = read_budget()
    sample = budget.sample.model_copy(update={"people": count, "frames": frames})
    return PeopleRun(budget.model_copy(update={"sample": sample}), sources=sources)
