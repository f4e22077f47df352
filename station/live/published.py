"""Publications of the live process: its set-up once, then updates.

LiveValues depend on the frames alone and are the same in live operation and in replay, to the bit. Delivery (age,
drops, decimation) depends on the computer. Between processes an update is a line of JSON, in which NaN is null.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Annotated

from pydantic import BeforeValidator, TypeAdapter

from documents.results import EqualByFields

NAN = float("nan")
Figure = Annotated[float, BeforeValidator(lambda value: NAN if value is None else value)]
"""A number that may be NaN."""


@dataclass(frozen=True)
class LiveSubject:
    """Whose body is solved. name of the model as the screen shows it; is_scaled: to the wearer of this session.

    model_osim is the model as an OpenSim file (its text), "" for the bundled one, so that a view can draw the body.
    """

    name: str
    is_scaled: bool
    model_osim: str = field(default="", repr=False)


@dataclass(frozen=True, eq=False)
class LiveScenario(EqualByFields):
    """A suit that is solved beside the others. rest_length_m is NaN for a slack cord.

    condition is "slack", or one of SuitScenario: "rigid", or "both" for cuffs as fitted; cuff is the arm cuff's name.
    """

    name: str
    condition: str
    rest_length_m: Figure
    cuff: str = ""


@dataclass(frozen=True, eq=False)
class LiveSetup(EqualByFields):
    """Names of everything that an update holds, in its order, and what is solved.

    lag_s is the lag of the smoother, frame_rate_hz that of the cameras; origin is "measured", "simulated" or "unknown"
    suit_toml is the text of the suit's file, "" for the bundled one, so that a view can draw the cord.
    """

    trial: str
    subject: LiveSubject
    coordinates: tuple[str, ...]
    muscles: tuple[str, ...]
    markers: tuple[str, ...]
    scenarios: tuple[LiveScenario, ...]
    lag_s: float
    frame_rate_hz: float
    emg_channels: tuple[str, ...] = ()
    has_glenoid: bool = True
    has_cord_cell: bool = False
    origin: str = "unknown"
    suit_toml: str = field(default="", repr=False)


@dataclass(frozen=True, eq=False)
class LiveScenarioValues(EqualByFields):
    """One scenario in one frame. NaN where the frame has no solution; outcome is a StreamSuitOutcome.

    effort is Σ w a² of the muscles, reserve_effort that of the actuators; joint_force_n (3,) acts on the scapula, in
    ground. A slack scenario is the reference: effort / its effort in the same frame is the effect of the suit now.
    """

    outcome: str
    effort: Figure
    reserve_effort: Figure
    activations: tuple[Figure, ...]
    cord_force_n: Figure
    joint_force_n: tuple[Figure, ...]


@dataclass(frozen=True, eq=False)
class LiveRecent(EqualByFields):
    """Of the last whole arm cycles: effort of every scenario over that of the slack one, and how many cycles."""

    cycles: int
    effort: Mapping[str, Figure]


@dataclass(frozen=True, eq=False)
class LiveBest(EqualByFields):
    """Best rest length of the motion so far: value, standard deviation over the cycles [m], effort over slack.

    edge is −1 or 1 where the shortest or longest length tried is the best: the best one is there or beyond.
    """

    rest_length_m: Figure
    sd_m: Figure
    effort: Figure
    cycles: int
    edge: int = 0


@dataclass(frozen=True, eq=False)
class LiveValues(EqualByFields):
    """One solved frame. time_s counts from the first frame, by the cameras' clock; it is lag_s before the newest one.

    frame is the camera's frame number; outcome is a StreamOutcome, and the fields after scenarios are those of
    StreamFrame. Coordinates [rad or m], speeds and accelerations are in the order of the set-up. emg_rms_uv is at the
    electrodes, in the order of the set-up's channels. host_time_s is when the frame was taken, in Unix time by its
    arrival.
    """

    time_s: float
    frame: int
    outcome: str
    coordinates: tuple[Figure, ...]
    speeds: tuple[Figure, ...]
    accelerations: tuple[Figure, ...]
    scenarios: tuple[LiveScenarioValues, ...]
    hidden: tuple[str, ...] = ()
    left_out: tuple[str, ...] = ()
    exchanged: tuple[tuple[str, str], ...] = ()
    lost: tuple[str, ...] = ()
    cord_force_measured_n: Figure = NAN
    emg_rms_uv: tuple[Figure, ...] = ()
    recent: LiveRecent | None = None
    best: LiveBest | None = None
    host_time_s: Figure = NAN


@dataclass(frozen=True)
class LiveFinding:
    """A remark for the operator: a code of station/messages/live_messages.py and its sentence."""

    code: str
    sentence: str


@dataclass(frozen=True, eq=False)
class LiveDelivery(EqualByFields):
    """Age of the values, and frames that were left out.

    published_s     Unix time of publication
    age_s           age of the values then: lag plus latency, from the arrival of their frame at the station
    latency_s       from the arrival of the newest frame until publication
    solved_frames, dropped_frames   since the start; dropped ones never reached the solver
    every           every N-th frame is solved
    solved_hz       frames solved per second of the cameras' clock
    not_shown       updates that this view has dropped, as it read too slowly
    """

    published_s: float
    age_s: Figure
    latency_s: Figure
    solved_frames: int
    dropped_frames: int
    every: int
    solved_hz: Figure
    not_shown: int = 0

    def age_at(self, now_s: float) -> float:
        """Age [s] of the values at this Unix time: what a view shows."""
        return self.age_s + now_s - self.published_s


@dataclass(frozen=True, eq=False)
class LiveUpdate(EqualByFields):
    """values is None while there is nothing to show (waiting, wearer outside the volume); see the findings."""

    values: LiveValues | None
    delivery: LiveDelivery
    findings: tuple[LiveFinding, ...] = ()
    scenarios: tuple[LiveScenario, ...] = ()  # as the rest lengths are now


SETUP = TypeAdapter(LiveSetup)
UPDATE = TypeAdapter(LiveUpdate)


def update_line(update: LiveUpdate) -> bytes:
    """The update as a line of JSON."""
    return UPDATE.dump_json(update) + b"\n"
