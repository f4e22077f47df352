"""A number of drawn people that gives no 95 % interval, but shows what becomes of it in seconds."""

from __future__ import annotations

from station.assessment.budget_file import read_budget
from station.assessment.people_run import PeopleRun, SourceChoice


def few_people(count: int, frames: int = 4, sources: SourceChoice = "all") -> PeopleRun:
    """A run with the bundled sources and so many people, each in about so many frames."""
    budget = read_budget()
    sample = budget.sample.model_copy(update={"people": count, "frames": frames})
    return PeopleRun(budget.model_copy(update={"sample": sample}), sources=sources)
