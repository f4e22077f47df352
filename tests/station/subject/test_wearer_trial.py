"""Motion trials of the simulated person, as the assessment reads them."""

from __future__ import annotations

import numpy as np

from fitting.wearer.wearer_trial import read_wearer_trial
from tests.station.wearer import SPECS, WearerSession

POSE, FREE, TIGHT = SPECS


def test_markers_are_where_the_person_had_them(wearer: WearerSession) -> None:
    trial = read_wearer_trial(wearer.path(FREE))
    truth = wearer.person.markers(wearer.starts[trial.file] + trial.time)
    recorded = [trial.labels.index(label) for label in trial.body.body]
    columns = [wearer.person.labels.index(label) for label in trial.body.body]
    error = 1e3 * trial.markers[:, recorded] - truth[:, columns]
    assert np.sqrt(np.nanmean(error**2)) < 0.5, "mm, of the cameras"


def test_the_tension_of_the_cord_is_there_where_it_was_measured(wearer: WearerSession) -> None:
    trial = read_wearer_trial(wearer.path(TIGHT))
    assert trial.body.is_cord_measured and 20 < np.ptp(trial.force) < 80
