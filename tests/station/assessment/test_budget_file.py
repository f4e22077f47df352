"""uncertainty.toml: every key of the bundled file, defaults for missing ones, and refusals that name the key."""

from __future__ import annotations

from pathlib import Path

import pytest

from solver.uncertainty.sources import UncertaintySources
from station.assessment.budget_file import BUNDLED_BUDGET, BudgetError, read_budget
from station.messages.codes import InputCode
from tests.refusals import raises_refusal


def written(folder: Path, text: str) -> Path:
    path = folder / "uncertainty.toml"
    path.write_text(text, encoding="utf-8")
    return path


def test_the_bundled_file_has_the_defaults_of_the_solver() -> None:
    found, own = read_budget().sources, UncertaintySources()
    assert (found.fit, found.donning, found.body, found.muscles) == (own.fit, own.donning, own.body, own.muscles)
    assert found.motion.posture == pytest.approx(own.motion.posture, abs=1e-4)
    assert found.motion.noise == pytest.approx(own.motion.noise, abs=1e-4)


def test_every_spread_of_the_bundled_file_has_its_origin_beside_it() -> None:
    text = BUNDLED_BUDGET.read_text(encoding="utf-8")
    spreads = text[text.index("[body]") :].splitlines()
    assert all("#" in line for line in spreads if "=" in line)


def test_missing_keys_keep_the_bundled_values(tmp_path: Path) -> None:
    path = written(tmp_path, "[donning]\nstiffness = 0.3\n[decision]\nrelevant_difference = 0.05\n")
    budget = read_budget(path, people=120)
    assert (budget.donning.stiffness, budget.donning.migration) == (0.3, 0.2)
    assert (budget.rule.relevant_difference, budget.rule.certainty, budget.sample.people) == (0.05, 0.9, 120)


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ("[donning]\nstifness = 0.3\n", "donning.stifness"),
        ('[donning]\nestimate = "yes"\n', "donning.estimate"),
        ("[muscles]\nstrength = -0.1\n", "muscles.strength"),
        ("[motion]\nposture_deg = 90.0\n", "motion.posture_deg"),
        ("[sample]\npeople = 39\n", "sample.people"),
        ("[sample]\npeople = -1\n", "sample.people"),
        ('[sample]\nmethod = "grid"\n', "sample.method"),
        ("donning = 3\n", "donning"),
        ("[donning\n", ""),
    ],
)
def test_a_file_that_cannot_be_used_is_refused_by_its_key(tmp_path: Path, text: str, reason: str) -> None:
    with raises_refusal(InputCode.BUDGET, kind=BudgetError) as caught:
        read_budget(written(tmp_path, text))
    assert reason in str(caught.value)


def test_a_missing_file_is_refused(tmp_path: Path) -> None:
    with raises_refusal(InputCode.BUDGET, kind=BudgetError):
        read_budget(tmp_path / "none.toml")
