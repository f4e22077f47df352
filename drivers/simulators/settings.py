"""Everything that can be set on the simulated bench, with every default in this one file.

The cuffs' figures are the published ones; loads, swing, sway and noise are assumed, as the publication prints none.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Any, Literal

from pydantic import BaseModel, ConfigDict, Field, ValidationError, model_validator

from documents.validation import describe_error
from drivers.simulators.errors import SimulatorCode, SimulatorError
from recordings.standard_gravity import g

Positive = Annotated[float, Field(gt=0)]
NotNegative = Annotated[float, Field(ge=0)]
Point = tuple[float, float, float]


class _Section(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True)


class CuffTruth(_Section):
    """One simulated cuff. migration_m is its slip after the protocol's heaviest load."""

    stiffness_n_per_m: Positive
    damping_n_s_per_m: NotNegative
    migration_m: NotNegative


PUBLISHED_CUFFS = {
    "waist": CuffTruth(stiffness_n_per_m=2140, damping_n_s_per_m=124, migration_m=0.012),
    "hand": CuffTruth(stiffness_n_per_m=8520, damping_n_s_per_m=210, migration_m=0.012),
    "tube": CuffTruth(stiffness_n_per_m=5510, damping_n_s_per_m=38, migration_m=0.009),
    "elbow": CuffTruth(stiffness_n_per_m=2530, damping_n_s_per_m=139, migration_m=0.022),
}


class CuffBody(_Section):
    """The cuff as a body: its mass, on the tissue side of the load cell, and its place on the anchor when donned."""

    mass_kg: Positive = 0.2
    position_mm: Point = (60.0, 20.0, -110.0)


class SlipLaw(_Section):
    """Friction between cuff and skin: nothing slips below first_slip_n, and slip raises the limit.

    The growth of the limit follows from the cuff's migration and the protocol's heaviest load. settling_s is the
    time constant with which a slip comes to rest under a constant load.
    """

    first_slip_n: NotNegative = 25.0
    settling_s: Positive = 0.3


class Rig(_Section):
    """Hook, rope and spring of the load. The rope leaves the cuff towards a pulley, fixed in the laboratory (z up)."""

    hook_n: Positive = 2.0
    rope_stiffness_n_per_m: Positive = 20_000.0
    rope_damping_n_s_per_m: NotNegative = 30.0
    spring_stiffness_n_per_m: Positive = 100.0
    pulley_mm: Point = (1150.0, 420.0, 1420.0)


class StaticTest(_Section):
    """Weights added one by one, each held, then taken off one by one, each level held again."""

    step_masses_kg: tuple[Positive, ...] = Field(default=(1.53, 1.53, 1.53, 1.53, 1.53), min_length=1)  # 15 N each
    lead_in_s: NotNegative = 3.0
    hold_s: Positive = 8.0
    shortest_hand_over_s: Positive = 0.3
    longest_hand_over_s: Positive = 0.7


class DynamicTest(_Section):
    """A spring whose far end a hand drives, so that the force swings about a mean; jitters are relative."""

    mean_n: Positive = 25.0
    amplitude_n: NotNegative = 12.0
    frequency_hz: Positive = 1.0
    amplitude_jitter: NotNegative = 0.06
    frequency_jitter: NotNegative = 0.04
    lead_in_s: NotNegative = 2.0
    hand_over_s: Positive = 1.5
    swing_s: Positive = 25.0
    lead_out_s: NotNegative = 2.0


class ProtocolSettings(_Section):
    """Trials of a cuff per donning: repeats × (static, dynamic)."""

    repeats: int = Field(default=3, ge=1)
    static: StaticTest = StaticTest()
    dynamic: DynamicTest = DynamicTest()


class BounceTest(_Section):
    """A weight on a steel spring under the load cell, pulled down, let go and caught; its marker, where it rests."""

    mass_kg: Positive = 2.5
    marker: str = "weight"
    frequency_hz: Positive = 1.0
    amplitude_mm: Positive = 80.0
    damping_ratio: float = Field(default=0.002, ge=0, lt=1)
    lead_in_s: NotNegative = 1.0
    hand_over_s: Positive = 1.0
    bounce_s: Positive = 28.0
    position_mm: Point = (900.0, -350.0, 800.0)


class RaiseSettings(_Section):
    """Cycles of one arm: up, hold, down, rest. Jitters are relative standard deviations, a lower raise is likelier."""

    cycles: int = Field(default=5, ge=1)
    lead_in_s: NotNegative = 2.0
    up_s: Positive = 1.8
    hold_s: Positive = 0.5
    down_s: Positive = 1.8
    rest_s: Positive = 0.9
    lead_out_s: NotNegative = 1.0
    duration_jitter: NotNegative = 0.05
    height_jitter: NotNegative = 0.04


class PersonSettings(_Section):
    """A person for pose and motion trials, who stands beside the bench (drivers/simulators/wearer.py).

    The soft tissue under each marker moves at random with this standard deviation per axis; facing_deg turns the person
    about the vertical. A tight cord is a linear spring, and relieves the muscles of a part of their activation.
    """

    pose_s: Positive = 8.0
    raises: RaiseSettings = RaiseSettings()
    position_mm: Point = (-700.0, 250.0, 1400.0)
    facing_deg: float = 35.0
    sway_mm: NotNegative = 2.0
    sway_deg: NotNegative = 0.3
    soft_tissue_mm: NotNegative = 2.0
    soft_tissue_hz: tuple[Positive, Positive] = (0.1, 2.0)
    cord_stiffness_n_per_m: Positive = 500.0
    cord_rest_length_m: Positive = 0.73
    cord_relief: float = Field(default=0.3, ge=0, lt=1)
    emg_full_mv: Positive = 0.5  # rms at full activation


class WearerSettings(_Section):
    """Position of the body in the laboratory, and its sway (standard deviations per axis)."""

    position_mm: Point = (140.0, -60.0, 1240.0)
    orientation_deg: Point = (4.0, -11.0, 25.0)  # rotation vector
    sway_mm: NotNegative = 2.0
    sway_deg: NotNegative = 0.3
    lowest_hz: Positive = 0.05
    highest_hz: Positive = 0.8


class MocapSettings(_Section):
    """The cameras and their markers: on the anchoring body (in its frame), on the cuff, on the rope (by distance).

    phase_s is the time from the edge of the sync line to the exposure of the first frame.
    """

    rate_hz: Positive = 100.0
    anchor_markers_mm: dict[str, Point] = {
        "anchor_1": (0.0, 0.0, 0.0),
        "anchor_2": (90.0, -35.0, 40.0),
        "anchor_3": (-60.0, 55.0, 75.0),
        "anchor_4": (25.0, 70.0, -70.0),
    }
    cuff_markers_mm: dict[str, Point] = {"cuff_1": (0.0, 0.0, 25.0)}
    rope_markers_mm: dict[str, float] = {"rope_1": 180.0, "rope_2": 420.0}
    noise_mm: NotNegative = 0.2
    occlusions_per_minute: NotNegative = 1.0
    mean_occlusion_s: Positive = 0.12
    phase_s: NotNegative = 0.0
    has_preview: bool = False
    password: str = ""
    camera_serials: tuple[int, ...] = (12056, 12059, 12039)
    calibrated: str = "2026-01-01 12:00:00"


class AmplifierSettings(_Section):
    """volts = zero_v + gain × newtons × full_scale_v / (capacity_kg × g), delay_s late, and white noise."""

    capacity_kg: Positive = 50.0
    full_scale_v: Positive = 5.0
    gain: Positive = 1.0
    delay_s: NotNegative = 0.0
    zero_v: float = 0.02
    noise_v: NotNegative = 0.005


class SyncLineSettings(_Section):
    """The mocap system's measurement-time output; inverted, it is low during the capture.

    It falls before_frame_end_s before the last frame's period ends, as a line does that falls with the exposure.
    """

    low_v: float = 0.0
    high_v: float = 5.0
    is_inverted: bool = False
    before_frame_end_s: NotNegative = 0.0


class EmgWire(_Section):
    """One EMG channel at an input of the DAQ, behind an amplifier."""

    input: str
    gain: Positive = 1000.0


class Wiring(_Section):
    """The DAQ by name, and the signals wired to its inputs; emg by the names of its channels."""

    device: str = "Dev1"
    force_channel: str = "ai0"
    sync_channel: str = "ai1"
    emg: dict[str, EmgWire] = Field(default_factory=dict)


class DaqClockSettings(_Section):
    """The DAQ's crystal against the world's clock, which is the mocap's: it runs fast by offset_ppm, and drifts."""

    offset_ppm: float = 20.0
    drift_ppm_per_hour: float = 2.0


class SerialLineSettings(_Section):
    """The indicator that streams ASCII lines."""

    line_format: Literal["usb220", "usb520"] = "usb220"
    rate_hz: Positive = 10.0


class OperatorSettings(_Section):
    """Start of a capture: "auto", an operator at the mocap PC, delay_s after all devices stream; "remote", a client.

    hands: "script", by the trial's own times; "led", step by step as a page asks for them (the request {"step": 1}).
    """

    capture: Literal["auto", "remote"] = "auto"
    hands: Literal["script", "led"] = "script"
    delay_s: NotNegative = 3.0


class Ports(_Section):
    """Ports on 127.0.0.1; 0 takes a free one, null leaves it out. clock is the world's, discovery QTM's over UDP."""

    ni: int | None = 0
    qtm: int | None = 0
    serial: int | None = 0
    clock: int | None = 0
    discovery: int | None = None


class Settings(_Section):
    """The simulated bench. Cuffs given here replace the published ones key by key."""

    cuffs: dict[str, CuffTruth] = Field(default_factory=lambda: dict(PUBLISHED_CUFFS))
    cuff_body: CuffBody = CuffBody()
    slip: SlipLaw = SlipLaw()
    rig: Rig = Rig()
    protocol: ProtocolSettings = ProtocolSettings()
    bounce: BounceTest | None = None
    person: PersonSettings | None = None
    wearer: WearerSettings = WearerSettings()
    mocap: MocapSettings = MocapSettings()
    amplifier: AmplifierSettings = AmplifierSettings()
    sync: SyncLineSettings = SyncLineSettings()
    wiring: Wiring = Wiring()
    daq_clock: DaqClockSettings = DaqClockSettings()
    serial: SerialLineSettings = SerialLineSettings()
    operator: OperatorSettings = OperatorSettings()
    ports: Ports = Ports()

    @model_validator(mode="before")
    @classmethod
    def _published_cuffs_show_through(cls, data: Any) -> Any:
        if not isinstance(data, dict) or not isinstance(data.get("cuffs"), dict):
            return data
        cuffs: dict[str, Any] = {name: truth.model_dump() for name, truth in PUBLISHED_CUFFS.items()}
        for name, change in data["cuffs"].items():
            cuffs[name] = {**cuffs.get(name, {}), **change} if isinstance(change, dict) else change
        return {**data, "cuffs": cuffs}

    @model_validator(mode="after")
    def _heaviest_load_slips(self) -> Settings:
        if self.peak_static_n <= self.slip.first_slip_n and any(cuff.migration_m > 0 for cuff in self.cuffs.values()):
            raise ValueError(
                f"slip.first_slip_n is {self.slip.first_slip_n:g} N, expected less than the heaviest static load of "
                f"{self.peak_static_n:g} N; lower it, or set every migration_m to 0"
            )
        return self

    @property
    def peak_static_n(self) -> float:
        """The heaviest load of the static test [N]."""
        return self.rig.hook_n + sum(self.protocol.static.step_masses_kg) * g


def settings_from_dict(data: Mapping[str, Any]) -> Settings:
    """Plain data over the defaults, e.g. {"cuffs": {"hand": {"stiffness_n_per_m": 6000}}}.

    Raises SimulatorError in one sentence that names the key.
    """
    try:
        return Settings.model_validate(dict(data))
    except ValidationError as error:
        raise SimulatorError(f"simulated bench: {describe_error(error)}", SimulatorCode.WRONG_SETTING) from error
