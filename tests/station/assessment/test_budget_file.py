"""uncertainty.toml: every key, defaults, refusals that name the key, and spreads from repeated donnings."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy import stats

from fitting.study.donning_spread import SpreadOutcome
from solver.uncertainty.factors import factor_columns, normal_scores, random_factors, scores_by_factor, unit_sample
from solver.uncertainty.sources import DonningSpread, FitSpread, UncertaintySources
from solver.uncertainty.varied_model import varied_cuff
from station.assessment.budget_file import BUNDLED_BUDGET, BudgetError, read_budget
from station.assessment.people_run import PeopleOptions, people_run
from station.assessment.uncertainty_json import donning_sources
from station.errors import UnusedOption
from station.messages.assessment_messages import InputCode
from station.messages.setup_messages import FolderCode
from station.messages.study_messages import StudyCode
from station.study.sessions import StudyError
from tests.refusals import raises_refusal
from tests.solver.uncertainty.test_people import CASE, HAND, MODEL
from tests.station.assessment.test_assess import write_cuffs
from tests.station.study.synthetic_sessions import MIGRATION, STIFFNESS, write_sessions

DECLARED = DonningSpread(0.5, 0.6, 0.7)


def written(folder: Path, text: str) -> Path:
    path = folder / "uncertainty.toml"
    path.write_text(text, encoding="utf-8")
    return path


def test_the_bundled_file_has_the_defaults_and_keeps_them_where_keys_are_missing(tmp_path: Path) -> None:
    found, own = read_budget().sources, UncertaintySources()
    assert (found.fit, found.donning, found.body, found.muscles) == (own.fit, own.donning, own.body, own.muscles)
    assert found.motion.posture == pytest.approx(own.motion.posture, abs=1e-4)
    assert found.motion.noise == pytest.approx(own.motion.noise, abs=1e-4)
    text = BUNDLED_BUDGET.read_text(encoding="utf-8")
    spreads = text[text.index("[body]") :].splitlines()
    assert all("#" in line for line in spreads if "=" in line)
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
        (None, "uncertainty.toml"),
    ],
)
def test_a_file_that_cannot_be_used_is_refused_by_its_key(tmp_path: Path, text: str | None, reason: str) -> None:
    with raises_refusal(InputCode.BUDGET, reason, kind=BudgetError):
        read_budget(tmp_path / "uncertainty.toml" if text is None else written(tmp_path, text))


@pytest.fixture(scope="module")
def session(tmp_path_factory: pytest.TempPathFactory) -> Path:
    (found,) = write_sessions(tmp_path_factory.mktemp("donnings"), 1, operators=1, donnings=12)
    return found


def test_repeated_donnings_of_the_assessed_session_replace_the_declared_spread(session: Path) -> None:
    found = donning_sources(DECLARED, session / "cuffs.json")
    assert found.is_estimated("stiffness")
    assert found.spread.stiffness == pytest.approx(STIFFNESS.donning / STIFFNESS.mean, rel=0.4)
    assert found.spread.migration == pytest.approx(MIGRATION.donning / MIGRATION.mean, rel=0.4)
    assert found.spread.freedom[0] == pytest.approx(22, abs=3), "24 donnings of two cuffs"
    entry = found.entries["stiffness"]
    assert entry.is_estimated and entry.donnings.value == 24
    assert entry.spread.ci95[0] < entry.spread.value < entry.spread.ci95[1]


def test_cuffs_by_hand_keep_the_declared_spread_unless_sessions_have_donnings(session: Path, tmp_path: Path) -> None:
    cuffs = write_cuffs(tmp_path / "cuffs.json")
    alone, more = donning_sources(DECLARED, cuffs), donning_sources(DECLARED, cuffs, [session])
    assert alone.spread == DECLARED
    assert alone.estimates["damping"].outcome is SpreadOutcome.FEW_DONNINGS
    assert alone.message.figures["stiffness"] == "stiffness 50 % (declared)"
    assert more.spread == donning_sources(DECLARED, session / "cuffs.json", [session]).spread
    assert more.message.code is InputCode.DONNING_SPREAD
    assert donning_sources(DECLARED, cuffs, [session], estimates=False).spread == DECLARED


def test_what_is_no_session_and_mixed_origins_are_refused(session: Path, tmp_path: Path) -> None:
    with raises_refusal(FolderCode.NOT_A_FOLDER, kind=StudyError):
        donning_sources(DECLARED, session / "cuffs.json", [tmp_path / "none"])
    simulated = write_sessions(tmp_path, 1, operators=1, origin="simulated")
    with raises_refusal(StudyCode.MIXED_ORIGIN, kind=StudyError):
        donning_sources(DECLARED, session / "cuffs.json", simulated)
    with (
        raises_refusal(InputCode.NO_PEOPLE, kind=UnusedOption),
        people_run(tmp_path, PeopleOptions(people=0, donnings=(session,))),
    ):
        pass


def test_cuffs_drawn_about_an_estimated_spread_have_the_t_distribution_of_its_degrees_of_freedom() -> None:
    donning = DonningSpread(0.1, 0.2, 0.3, freedom=(5.0, np.inf, 12.0))
    sources = replace(UncertaintySources(), donning=donning, fit=FitSpread(0.0))
    factors = random_factors(sources, MODEL, (HAND,))
    scores = normal_scores(unit_sample(factors, 2000, "latin_hypercube", seed=2))
    assert len(factor_columns(factors, ["donning_spread"])) == 3
    assert not len(factor_columns(CASE.factors, ["donning_spread"])), "a declared spread needs no further scores"
    drawn = [varied_cuff(HAND, sources.fit, donning, scores_by_factor(factors, row)) for row in scores]
    for name, spread, freedom in (("stiffness", 0.1, 5.0), ("damping", 0.2, np.inf), ("migration", 0.3, 12.0)):
        logs = np.log([getattr(cuff, name) / getattr(HAND, name) for cuff in drawn]) / (np.sqrt(2) * spread)
        if name == "stiffness":
            logs = logs[logs > np.log(0.05) / (np.sqrt(2) * spread) + 1e-9]  # the least stiffness of a drawn cuff
        assert stats.kstest(logs, stats.t(freedom).cdf).pvalue > 0.01
