from __future__ import annotations

import numpy as np

from fitting.cuffs.cuff_fit import CuffFit
from fitting.cuffs.wearable_cuff import Cuff
from fitting.results.codes import Verdict
from fitting.uncertainty import Estimate
from station.cuff_text import of_cuff


def test_a_figure_that_is_not_identified_is_marked() -> None:
    wide, known = Estimate(210.0, 120.0, (-25.0, 445.0)), Estimate(8520.0, 10.0, (8500.0, 8540.0))
    fit = CuffFit("hand", "arm", "1", known, wide, None, (Verdict.LAG,), np.zeros((3, 3)), {})
    assert of_cuff(fit, "damping", "210 ± 240") == "not identified: 210 ± 240"
    assert of_cuff(fit, "stiffness", "8520 ± 20") == "8520 ± 20"
    assert of_cuff(fit, "migration", "not identified") == "not identified"


def test_a_figure_that_was_entered_by_hand_is_marked() -> None:
    known = Estimate(8520.0, 10.0, (8500.0, 8540.0))
    cuff = Cuff("hand", stiffness=known, damping=210.0)
    assert of_cuff(cuff, "damping", "210") == "210 (given by hand)"
    assert of_cuff(cuff, "stiffness", "8520 ± 20") == "8520 ± 20"
