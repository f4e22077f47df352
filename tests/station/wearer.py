"""A session of a wearer on the simulated bench: a pose, a motion without the suit and one with a tight cord, with EMG.

Recorded once for all processes by the fixture `wearer` (tests/station/conftest.py), in two seconds.
"""

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from drivers.simulators.settings import settings_from_dict
from drivers.simulators.simulated_bench import Bench
from drivers.simulators.wearer import Person
from station.bench.bench_clock import BenchClock
from station.bench.simulation import simulator_settings
from station.bench.trial_recorder import TrialRecorder, TrialResult
from station.config import StationConfig, parse_config
from station.protocol import TrialSpec

SOFT_TISSUE_MM = 2.0
CYCLES = 3
GAIN = 500.0
SPECS = (
    TrialSpec(None, "pose", 1),
    TrialSpec(None, "motion", 1, condition="unsuited"),
    TrialSpec(None, "motion", 1, condition="tight"),
)
BODY: dict[str, Any] = {
    "markers": ["ij", "px", "c7", "t8", "ac", "aa", "ts", "ai", "gu", "EpL", "EpM"],
    "suit_markers": ["cord_waist", "cord_shoulder", "cord_arm"],
    "arm": ["ac", "EpL"],
    "trunk": ["c7", "t8"],
    "pose_s": 2.5,
    "cycles": CYCLES,
    "is_cord_measured": True,
}


def wearer_config() -> StationConfig:
    from station.demo import demo_config  # with all that a demo needs, while other tests need the type alone

    plain = demo_config().model_dump(mode="json")
    plain["cuffs"] = {"hand": plain["cuffs"]["hand"]}
    plain["body"], plain["sync"]["stop_edge"] = BODY, "end_of_frame"
    channels = {"deltoid": {"input": "ai2", "gain": GAIN}, "trapezius": {"input": "ai3", "gain": GAIN}}
    plain["emg"] = {"channels": channels, "range_v": 2.0}
    plain["simulation"] = {"person": {"soft_tissue_mm": SOFT_TISSUE_MM}}
    return parse_config(plain, "test")


@dataclass
class WearerSession:
    """results and the start of each capture [world s] by file name; person gives the truth at any world time."""

    folder: Path
    config: StationConfig
    person: Person
    results: dict[str, TrialResult] = field(default_factory=dict)
    starts: dict[str, float] = field(default_factory=dict)

    def path(self, spec: TrialSpec) -> Path:
        return self.folder / spec.file_name(1)


def record_wearer(folder: Path) -> WearerSession:
    config = wearer_config()
    plain = simulator_settings(config)
    with Bench(settings_from_dict(plain), speed=None, seed=5) as bench:
        assert bench.world.person is not None
        data = config.model_dump(mode="json")
        data["daq"]["grpc_target"] = f"127.0.0.1:{bench.ports['ni']}"
        data["mocap"] |= {"host": "127.0.0.1", "port": bench.ports["qtm"]}
        session = WearerSession(folder, parse_config(data, "test"), bench.world.person)
        for spec in SPECS:
            bench.world.select_trial(None, spec.test, spec.condition)
            with BenchClock(bench.ports["clock"]) as clock:
                result = TrialRecorder(session.config, clock).record(folder, spec)
            assert result.path is not None, result.sentence
            assert bench.world.capture is not None
            session.results[result.path.name] = result
            session.starts[result.path.name] = bench.world.capture.start
    return session
