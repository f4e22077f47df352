"""What is solved in a trial, from configuration and session: the same in live operation and in replay."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from recordings.manifest import BodyMarkers
from solver.stream.frame_muscles import StreamScenario
from solver.suit.suit import suit_toml
from station.config import LiveSection, StationConfig
from station.live.body import UNUSABLE, LiveBody, live_body, live_scenarios
from station.live.pipeline import LivePlan
from station.live.published import LiveScenario, LiveSetup, LiveSubject
from station.messages.live_messages import LiveCode
from station.messages.message import Message
from station.protocol import BODY_TESTS, TrialSpec


@dataclass(frozen=True, eq=False)
class PreparedTrial:
    """A plan with the names of its scenarios, and what an operator must know of it."""

    trial: str
    plan: LivePlan
    settings: LiveSection
    scenarios: tuple[LiveScenario, ...]
    findings: tuple[Message[LiveCode], ...]

    def setup(self, labels: tuple[str, ...], rate_hz: float, origin: str, emg: tuple[str, ...] = ()) -> LiveSetup:
        """For these markers of the cameras."""
        body = self.plan.body
        tasks, _ = body.tasks_for(labels)
        return LiveSetup(
            trial=self.trial,
            subject=LiveSubject(body.name, is_scaled=body.is_scaled, model_osim=body.osim_text),
            coordinates=body.model.coordinate_names,
            muscles=body.model.muscle_names,
            markers=tuple(marker.name for marker in tasks.markers),
            scenarios=self.scenarios,
            lag_s=self.plan.lag_s,
            frame_rate_hz=rate_hz,
            emg_channels=emg,
            has_glenoid=body.has_glenoid,
            has_cord_cell=self.plan.cell is not None,
            origin=origin,
            suit_toml=suit_toml(body.suit),
        )


def can_be_solved(spec: TrialSpec) -> bool:
    """Whether the trial has markers on the wearer's body."""
    return spec.test in BODY_TESTS


def prepare_trial(config: StationConfig, folder: Path, spec: TrialSpec, before_utc_ns: int) -> PreparedTrial:
    """Raises SolverError for a model or a suit of [live] that cannot be read."""
    settings = config.live
    body = live_body(folder, settings, before_utc_ns)
    findings = list(body.findings)
    scenarios, described = _scenarios(folder, config, body, findings)
    subject = config.subject(spec)
    markers = subject if isinstance(subject, BodyMarkers) else None
    plan = LivePlan(
        body=body,
        scenarios=scenarios,
        lag_s=settings.lag_s,
        highest_rate_hz=float(settings.highest_rate_hz),
        markers=markers,
        cell=config.calibration() if markers is not None and markers.is_cord_measured else None,
        emg=config.emg.amplifier() if config.emg is not None else None,
    )
    return PreparedTrial(spec.title, plan, settings, described, tuple(findings))


def _scenarios(
    folder: Path, config: StationConfig, body: LiveBody, findings: list[Message[LiveCode]]
) -> tuple[dict[str, StreamScenario], tuple[LiveScenario, ...]]:
    try:
        return live_scenarios(folder, config.live, body)
    except UNUSABLE as error:
        findings.append(Message(LiveCode.NO_CUFFS, {"reason": str(error)}))
        return live_scenarios(None, config.live.without_cuffs(), body)
