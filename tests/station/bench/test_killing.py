"""A daemon that is killed at any instant loses at most half a second, and says what is missing."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from recordings.reader import open_recording
from tests.station.killing import DAEMONS, LOSS_BOUND_S, KillBench, ensure_contiguous, ensure_recovered
from tests.timeout import scaled_timeout


@pytest.mark.slow
@pytest.mark.timeout(900)
def test_twenty_killed_daemons_leave_all_but_half_a_second(tmp_path: Path) -> None:
    random = np.random.default_rng(5)
    with KillBench(tmp_path) as bench:
        killed = [one for _ in range(2) for one in bench.kill(random.uniform(0, 10, DAEMONS).tolist())]
    for one in killed:
        assert max(one.losses_s().values()) <= scaled_timeout(LOSS_BOUND_S)
        ensure_contiguous(open_recording(one.path))
        ensure_recovered(one.path)
    assert len(killed) == 20
    assert max(one.killed_s for one in killed) - min(one.killed_s for one in killed) > 8.0
