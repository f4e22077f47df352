"""Cuffs as a user gives them in Python."""

import json
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest

from drivers.simulators.settings import PUBLISHED_CUFFS
from fitting.cuffs.cuff_fit import CuffFit, SessionFit
from fitting.cuffs.cuff_tables import CuffsLike, cuffs_by_name, published_cuffs
from fitting.cuffs.wearable_cuff import Cuff, NotIdentified, with_interval_covariance
from fitting.errors import CodedError
from fitting.results.codes import FitErrorCode, Verdict
from fitting.uncertainty import Estimate, normal_estimate
from tests.refusals import raises_refusal

HAND = Cuff("hand", stiffness=8520, damping=210, migration=0.012)
FIGURES = {"stiffness": 8520, "damping": 210, "migration": 0.012}
SUFFIXED = {"stiffness_n_per_m": 8520.0, "damping_n_s_per_m": 210.0, "migration_m": 0.012}
ESTIMATES = normal_estimate(8520, 30), normal_estimate(210, 10), normal_estimate(0.012, 1e-4)
FIT = CuffFit("hand", "arm", "1", *ESTIMATES, (Verdict.IDENTIFIED,), np.diag([900.0, 100.0, 1e-8]))
ROWS = pd.DataFrame(
    {"name": ["hand", "waist"], "stiffness": [8520, 2140], "damping": [210, 124], "migration": [0.012] * 2}
)


@pytest.mark.parametrize(
    "given",
    [
        HAND,
        [HAND],
        {"hand": HAND},
        {"hand": FIGURES},
        {"hand": SUFFIXED},
        {"hand": {**FIGURES, "stiffness_n_per_m": np.nan}},
        {"name": "hand", **FIGURES},
        [{"cuff": "hand", "site": "arm", **FIGURES}],
        {"hand": {**FIGURES, "stiffness": {"value": 8520}}},
        ROWS.iloc[0],
        {"hand": ROWS.iloc[0].drop("name")},
        ROWS[:1],
        ROWS.set_index("name").loc["hand"],
        ROWS.set_index("name")[:1],
        pd.DataFrame(SUFFIXED, index=["hand"]),
    ],
)
def test_a_cuff_may_be_given_in_many_forms(given: CuffsLike) -> None:
    (cuff,) = cuffs_by_name(given).values()
    assert (cuff.name, cuff.site, cuff.missing, set(cuff.given)) == ("hand", "arm", (), set(FIGURES))
    worn, expected = cuff.parameters(), HAND.parameters()
    assert (worn.stiffness, worn.damping, worn.migration) == (expected.stiffness, expected.damping, expected.migration)


def test_a_table_has_a_cuff_in_every_row_and_a_fit_keeps_its_errors(tmp_path: Path) -> None:
    assert [cuff.site for cuff in cuffs_by_name(ROWS).values()] == ["arm", "waist"]
    session = SessionFit({"hand": {"1": FIT}}, ())
    for given in (FIT, session, session.cuffs, FIT.to_dataframe(), session.to_dataframe()):
        cuff = cuffs_by_name(given)["hand"]
        np.testing.assert_allclose(np.diag(cuff.covariance), [900.0, 100.0, 1e-8])
    file = tmp_path / "cuffs.json"
    file.write_text(json.dumps({"cuffs": {"hand": SUFFIXED}}), encoding="utf-8")
    assert cuffs_by_name(str(file)) == cuffs_by_name(file) == {"hand": HAND}


def test_a_number_with_a_standard_error_has_a_normal_interval() -> None:
    cuff = Cuff("hand", stiffness=(8520, 30), damping=210, migration=0.012)
    assert cuff.stiffness == normal_estimate(8520.0, 30.0)
    np.testing.assert_array_equal(np.diag(cuff.covariance), [900.0, 0.0, 0.0])


def test_the_published_cuffs_are_those_of_the_simulators() -> None:
    expected = {name: tuple(truth.model_dump().values())[:3] for name, truth in PUBLISHED_CUFFS.items()}
    found = {name: cuff.parameters() for name, cuff in published_cuffs().items()}
    assert {name: (cuff.stiffness, cuff.damping, cuff.migration) for name, cuff in found.items()} == expected
    assert [cuff.site for cuff in found.values()] == ["waist", "arm", "arm", "arm"]


ABOVE_ONE = np.ones((3, 3)) + np.eye(3)[[1, 0, 2]]  # correlations
NOT_SEMI_DEFINITE = np.array([[1.0, 0.9, -0.9], [0.9, 1.0, 0.9], [-0.9, 0.9, 1.0]])
COVARIANCES = np.eye(2), np.full((3, 3), np.nan), -np.eye(3), ABOVE_ONE, np.full((3, 3), np.inf), NOT_SEMI_DEFINITE


@pytest.mark.parametrize(
    ("name", "given"),
    [
        *((name, {}) for name in ("../hand", "", 3)),
        ("hand", {"site": "leg"}),
        *(("hand", {"covariance": covariance}) for covariance in (*COVARIANCES, "unknown")),
    ],
)
def test_a_name_site_or_covariance_of_no_cuff_is_refused(name: Any, given: dict[str, Any]) -> None:
    with pytest.raises(ValueError, match="should be"):
        Cuff(name, stiffness=8520, **given)


@pytest.mark.parametrize(
    ("give", "code"),
    [
        *(
            (partial(Cuff, "hand", **figures), FitErrorCode.CUFF_IMPOSSIBLE)
            for figures in ({"stiffness": -1}, {"stiffness": np.nan}, {"stiffness": (8520, -3)}, {"migration": 12})
        ),
        (partial(cuffs_by_name, {"hand": {"stiffness": 8520, "migration_mm": 12}}), FitErrorCode.CUFF_KEY),
        (partial(cuffs_by_name, {"hand": {**FIGURES, **SUFFIXED}}), FitErrorCode.CUFF_KEY),
        (partial(cuffs_by_name, FIGURES), FitErrorCode.CUFF_NAME),
        (partial(cuffs_by_name, [HAND, HAND]), FitErrorCode.CUFF_TWICE),
        (partial(cuffs_by_name, ROWS.drop(columns="name")), FitErrorCode.CUFF_NAME),
    ],
)
def test_what_is_no_cuff_is_refused_with_a_code(give: Callable[[], object], code: FitErrorCode) -> None:
    with raises_refusal(code, kind=CodedError):
        give()


@pytest.mark.parametrize("given", [3, "x", {"hand": 3}, {"hand": {"stiffness": "8520"}}, [None]])
def test_another_type_is_refused(given: object) -> None:
    with pytest.raises((TypeError, CodedError)) as refused:
        cuffs_by_name(given)  # type: ignore[arg-type]
    assert isinstance(refused.value, TypeError) or refused.value.code == FitErrorCode.CUFFS_UNREADABLE


def test_a_gap_in_a_table_is_a_missing_figure() -> None:
    cuff = cuffs_by_name(ROWS.assign(damping=[np.nan, 124]))["hand"]
    assert cuff.missing == ("damping",)
    with pytest.raises(NotIdentified):
        cuff.parameters()


def _fit() -> CuffFit:
    """k with an interval twice as wide as 1.96 standard errors, c and migration with normal ones."""
    covariance = np.array([[100.0, 30.0, 0.0], [30.0, 25.0, 0.0], [0.0, 0.0, 1e-8]])
    wide = Estimate(5000.0, 10.0, (5000 - 2 * 19.59963984540054, 5000 + 2 * 19.59963984540054))
    estimates = wide, normal_estimate(100.0, 5.0), normal_estimate(0.01, 1e-4)
    return CuffFit("hand", "arm", "1", *estimates, (Verdict.IDENTIFIED,), covariance)


def test_the_covariance_gives_the_fit_s_intervals_and_keeps_the_correlation() -> None:
    found = with_interval_covariance(_fit().wearable()).covariance
    np.testing.assert_allclose(np.sqrt(np.diag(found)), [20.0, 5.0, 1e-4], rtol=1e-12)
    assert found[0, 1] / np.sqrt(found[0, 0] * found[1, 1]) == pytest.approx(30 / 50)
    fit = replace(_fit(), stiffness=Estimate(5000.0, 10.0, (5000.0, 5000.0)))
    assert with_interval_covariance(fit.wearable()).covariance[0, 0] == pytest.approx(100.0)
