"""What a misbehaving sync line does to one trial, recorded by the daemon over the real wires, and who says so."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from drivers.simulators.faults import Fault, Faults, fault_from_dict
from drivers.simulators.settings import Settings, settings_from_dict
from drivers.simulators.simulated_bench import Bench
from fitting.errors import UnusableTrial
from fitting.trial.decimation import decimate
from fitting.trial.sync_certificate import SyncCertificate, certify
from recordings.reader import open_recording
from recordings.samples import Event, Item
from station.bench.bench_clock import BenchClock
from station.bench.trial_recorder import TrialRecorder, TrialResult
from station.bench.view import Snapshot, TrialState
from station.config import StationConfig, parse_config
from station.protocol import TrialSpec

ARMED_FOR_S = 2.0
"""Station seconds after which a fault that concerns an armed station happens."""


@dataclass(frozen=True)
class Case:
    """One fault of the sync line, and what must be seen of it.

    event     of the station, while it happens; "" where nothing can be known before the trial is over
    accepted  whether the daemon accepts the trial
    words     of the trial's result, of the certificate's findings, or of the reason why there is none
    """

    fault: str
    when: dict[str, Any]
    event: str
    accepted: bool
    words: str
    while_armed: bool = False

    @property
    def name(self) -> str:
        return f"{self.fault.replace('_', ' ')}{' while armed' if self.while_armed else ''}"

    @property
    def plan(self) -> Fault:
        return fault_from_dict({"device": "sync", "fault": self.fault, **self.when})


CASES = (
    Case("glitch", {"at_s": 0.3}, "sync_glitch", True, r"start and stop edge: offset", while_armed=True),
    Case("glitch", {"at_s": 2.0}, "sync_glitch", True, r"glitch: the sync line is low during the capture 1 time"),
    Case("early_edge", {"for_s": 0.4}, "", True, r"early edge: the sync line rose 0\.40 s before the first frame"),
    Case("double_edge", {"at_s": 0.5}, "sync_double_edge", False, r"the sync line rises 2 times"),
    Case("no_stop_edge", {}, "no_stop_edge", True, r"start edge alone.*has not fallen when the recording ends"),
    Case("wrong_polarity", {"capture": 0}, "", False, r"the sync line fell from 5\.\d\d V .* active high"),
)


@dataclass(frozen=True)
class Suffered:
    """What became of the trial; certificate is None where there is none, and words says why.

    reported_after_s  world seconds from the fault to the station's event, None without one
    """

    result: TrialResult
    events: tuple[Event, ...]
    certificate: SyncCertificate | None
    words: str
    reported_after_s: float | None


@dataclass
class _Meddler:
    """A view that lets a fault happen once the station has been armed for a while."""

    fault: Fault
    faults: Faults
    has_meddled: bool = False

    def offer(self, item: Item) -> None: ...

    def show(self, snapshot: Snapshot) -> None:
        if not self.has_meddled and snapshot.state is TrialState.ARMED and snapshot.waited_s > ARMED_FOR_S:
            self.has_meddled = True
            self.faults.inject(self.fault)


def suffer(case: Case, folder: Path, speed: float | None = None) -> Suffered:
    """Records one short capture in which the fault happens."""
    with Bench(_settings(), speed, seed=3, fault_plan=() if case.while_armed else [case.plan]) as bench:
        world = bench.world
        views = [_Meddler(case.plan, world.faults)] if case.while_armed else []
        with BenchClock(bench.ports["clock"]) as clock:
            result = TrialRecorder(_config(bench), clock, views).record(folder, TrialSpec("waist", "static", 1))
        capture = world.capture
        assert capture is not None
        moment = capture.end if case.fault == "no_stop_edge" else world.faults.of("sync", case.fault)[0].begin
        moment_utc_ns = bench.start_utc_ns + int(moment * 1e9)
    if result.path is None:
        return Suffered(result, (), None, result.sentence, None)
    recording = open_recording(result.path)
    events = tuple(item for item in recording.items() if isinstance(item, Event))
    times_ns = [event.host_time_ns for event in events if case.event and event.kind == case.event]
    after_s = (times_ns[0] - moment_utc_ns) * 1e-9 if times_ns else None
    try:
        tracks = {stream.name: recording.load(stream.name) for stream in recording.streams}
        certificate = certify(recording.manifest, decimate(recording.manifest, tracks))
    except UnusableTrial as error:
        return Suffered(result, events, None, str(error), after_s)
    assert certificate is not None
    return Suffered(
        result, events, certificate, "; ".join(map(str, (certificate.summary, *certificate.findings))), after_s
    )


def _settings() -> Settings:
    return settings_from_dict(
        {
            "ports": {"serial": None},
            "operator": {"delay_s": 2 * ARMED_FOR_S},
            "protocol": {"static": {"lead_in_s": 1.0, "hold_s": 2.0, "step_masses_kg": [3.0]}},
            "mocap": {"occlusions_per_minute": 0},
        }
    )


def _config(bench: Bench) -> StationConfig:
    return parse_config(
        {
            "daq": {"grpc_target": f"127.0.0.1:{bench.ports['ni']}"},
            "mocap": {"port": bench.ports["qtm"]},
            "sync": {"stop_edge": "end_of_frame"},
            "cuffs": {"waist": {"anchor_markers": bench.world.labels[:4], "cuff_markers": ["cuff_1"]}},
        },
        "test",
    )
