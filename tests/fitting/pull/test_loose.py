"""One marker of the anchor that moves among the others."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from fitting.pull.marker_quality import loose_marker
from fitting.results.codes import CauseCode, TrialNoteCode
from fitting.session import fit_session
from fitting.trial.trial import Trial, build_trial
from tests.fitting.experiment import Session, published
from tests.fitting.refusals import figures_by_code

PLACES = np.array([[0.0, 0.04, 0.0], [0.05, -0.03, 0.10], [-0.05, -0.02, 0.14], [0.02, 0.05, 0.22], [0.06, 0.0, 0.05]])
NAMES = tuple(f"anchor_{i}" for i in range(1, 6))


def _seen(seed: int, count: int, loose: int | None, way: float) -> np.ndarray:
    """(frames, markers, 3) with noise of 0.2 mm; the body rests, as a pose takes its motion out anyway."""
    random = np.random.default_rng(seed)
    points = PLACES[:count] + 0.2e-3 * random.standard_normal((3000, count, 3))
    if loose is not None:
        slow = np.repeat(random.standard_normal((100, 3)), 30, axis=0)
        points[:, loose] += way * slow / np.sqrt(3)
    return points


@pytest.mark.parametrize("count", [4, 5])
@pytest.mark.parametrize("loose", range(4))
def test_a_marker_that_moves_by_a_millimetre_is_named_with_its_way(count: int, loose: int) -> None:
    found = loose_marker(NAMES[:count], PLACES[:count], _seen(loose, count, loose, 1e-3))
    assert found
    label, way = found
    assert label == NAMES[loose]
    assert way == pytest.approx(1e-3, rel=0.35)


@pytest.mark.parametrize("seed", range(20))
def test_noise_of_the_cameras_names_no_marker(seed: int) -> None:
    assert loose_marker(NAMES[:4], PLACES[:4], _seen(seed, 4, None, 0.0)) is None
    assert loose_marker(NAMES[:4], PLACES[:4], _seen(seed, 4, 1, 0.2e-3)) is None


def test_with_three_markers_the_loose_one_is_unknown() -> None:
    assert loose_marker(NAMES[:3], PLACES[:3], _seen(1, 3, 1, 3e-3)) is None


def test_a_loose_marker_is_a_cause_and_a_note_of_its_trials() -> None:
    session = Session(published("hand", friction=1e9, migration=0.0, hold=4.0, duration=12.0), 5)
    firm = [build_trial(*session.static(), "s", "s"), build_trial(*session.dynamic(), "d", "d")]
    (fit,) = fit_session([_with_loose(each) for each in firm]).cuffs.values()
    assert fit.diagnosis
    assert CauseCode.LOOSE_MARKER in [cause.code for cause in fit.diagnosis.causes[:2]]
    assert all(figures_by_code(trial.notes)[TrialNoteCode.LOOSE_MARKER]["marker"] == "anchor_3" for trial in fit.trials)
    (fit,) = fit_session(firm).cuffs.values()
    assert fit.diagnosis
    assert fit.diagnosis.causes == ()


def _with_loose(trial: Trial) -> Trial:
    markers = trial.markers.copy()
    slow = np.random.default_rng(2).standard_normal((len(markers) // 30 + 1, 3)).repeat(30, axis=0)[: len(markers)]
    markers[:, trial.labels.index("anchor_3")] += 1e-3 / np.sqrt(3) * slow
    return replace(trial, markers=markers)
