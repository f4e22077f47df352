"""Live values in Rerun: the same rows from a live process and from the values themselves."""

from __future__ import annotations

import re
import subprocess
import sys
from collections import Counter
from pathlib import Path

from station.live.address import find_address
from station.live.published import LiveFinding
from station.live.subscription import LiveSubscription
from station.viewer.live_scene import LiveScene, show_live
from tests.station.console.live_source import LiveSource

FRAMES = 50
COMPONENTS = "scalars|strips|text"


def rows_in(file: Path) -> Counter[str]:
    """Rows over time by entity, counted by Rerun's own reader."""
    words = [sys.executable, "-m", "rerun", "rrd", "print", "-v", str(file)]
    printed = subprocess.run(words, check=True, capture_output=True, encoding="utf-8").stdout  # noqa: S603  (our own words)
    rows: Counter[str] = Counter()
    for count, name in re.findall(rf"with (\d+) rows .* - /([\w/]+) - .*:(?:{COMPONENTS})\]", printed):
        rows[name] += int(count)
    return rows


def test_a_live_process_fills_body_curves_and_findings(tmp_path: Path) -> None:
    file = tmp_path / "live.rrd"
    findings = (LiveFinding("live.not_held", "elbow_flexion is an estimate"),)
    with LiveScene(file) as scene:
        with LiveSource(tmp_path, findings=findings) as source:
            address = find_address(tmp_path)
            assert address is not None
            subscription = LiveSubscription(address)
            for _ in range(FRAMES):
                source.publish()
        with subscription:
            show_live(subscription, [scene])
    rows = rows_in(file)
    for name in ("effort/slack", "effort/worn", "cord_force_n/predicted", "cord_force_n/measured", "emg_uv/deltoid"):
        assert rows[f"live/{name}"] == FRAMES, name
    for name in ("muscles", "bones", "cord"):
        assert rows[f"body/{name}"] == FRAMES, "frames are 0.04 s apart"
    assert rows["events"] == 2, "whose body it is, and a finding once"
