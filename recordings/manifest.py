"""Subject, time, cuff and devices: everything a fit needs beside the samples, written before the first of them.

And, written after the last of them, how the trial ended.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from enum import StrEnum
from functools import cache
from pathlib import PureWindowsPath
from typing import Annotated, Any, Literal

from pydantic import Field, TypeAdapter, ValidationError

from documents.plain_data import PlainDataError, parse_json
from documents.validation import describe_error
from recordings.errors import RecordingCode, RecordingError
from recordings.samples import DeviceIdentity

LONGEST_NAME = 200
"""Characters of a file's name."""

TestKind = Literal["static", "dynamic", "bounce", "pose", "motion"]
PullKind = Literal["static", "dynamic"]
"""The tests of a cuff."""
TrialCondition = Literal["unsuited", "slack", "tight", "mvc"]
"""Of a pose or motion trial: without the suit, in the suit with its cord slack or tight, or a maximal voluntary
contraction for the normalisation of EMG."""
StopEdge = Literal["end_of_frame", "end_of_exposure", "anywhere"]


class DataOrigin(StrEnum):
    """Whether samples come from instruments or from simulated devices."""

    MEASURED = "measured"
    SIMULATED = "simulated"
    UNKNOWN = "unknown"

    @classmethod
    def of_devices(cls, devices: Iterable[DeviceIdentity]) -> DataOrigin:
        """Origin as reported by the devices of a trial: simulated if any of them is."""
        claims = {device.is_simulated for device in devices}
        if True in claims:
            return cls.SIMULATED
        return cls.MEASURED if claims == {False} else cls.UNKNOWN

    @classmethod
    def joined(cls, origins: Iterable[DataOrigin]) -> DataOrigin:
        """Of a result that several recordings went into: simulated if any of them is."""
        found = set(origins)
        if cls.SIMULATED in found:
            return cls.SIMULATED
        return cls.MEASURED if found == {cls.MEASURED} else cls.UNKNOWN


@dataclass(frozen=True)
class CuffSite:
    """The cuff under test and its markers, by label.

    site is "arm" or "waist"; rope_markers is empty where the rope carries none. mass_kg moves with the cuff between
    load cell and body; None where it is not declared.
    """

    name: str
    site: Literal["arm", "waist"]
    anchor_markers: tuple[str, ...]
    cuff_markers: tuple[str, ...]
    rope_markers: tuple[str, ...] = ()
    mass_kg: float | None = None

    @property
    def labels(self) -> tuple[str, ...]:
        """All markers that must be there: anchor, cuff, rope."""
        return self.anchor_markers + self.cuff_markers + self.rope_markers


@dataclass(frozen=True)
class BounceRig:
    """Oscillator under the load cell that calibrates it: a weight on a steel spring, and the marker on the weight.

    spring_mass_kg is the spring's own; mass_relative_sd the standard uncertainty of both masses.
    """

    mass_kg: Annotated[float, Field(gt=0)]
    marker: Annotated[str, Field(min_length=1)]
    spring_mass_kg: Annotated[float, Field(ge=0)] = 0.0
    mass_relative_sd: Annotated[float, Field(ge=0)] = 0.0005

    @property
    def labels(self) -> tuple[str, ...]:
        """All markers that must be there."""
        return (self.marker,)


@dataclass(frozen=True)
class BodyMarkers:
    """The markers of a pose or motion trial, by label.

    body   on the wearer's body;  suit  on the suit and its cuffs, where the suit is worn
    arm    the shoulder and the elbow;  trunk  an upper and a lower point of the trunk. The angle between arm and trunk
           is the elevation of the arm. Empty where they are not declared
    is_cord_measured  whether the load cell measures the tension of the suit's cord
    """

    body: tuple[str, ...]
    suit: tuple[str, ...] = ()
    arm: tuple[str, ...] = ()
    trunk: tuple[str, ...] = ()
    is_cord_measured: bool = False

    @property
    def labels(self) -> tuple[str, ...]:
        """All markers that must be there."""
        return self.body + self.suit


TrialSubject = CuffSite | BounceRig | BodyMarkers
"""Subject of a trial; labels are the markers that it needs."""


@dataclass(frozen=True)
class EmgAmplifier:
    """Conversion of /emg to volts at the electrodes: volts = value × volts per Stream.unit / gain.

    gains           by channel label; 1 for a channel that is not listed
    sync_threshold  of /emg_sync in its own unit; None where the amplifier does not record the sync line
    lag_s           an EMG sample stamped t was taken at t + lag_s by the markers' clock
    lag_sd_s        its standard uncertainty
    """

    source: Literal["daq", "lsl"]
    gains: dict[str, float] = field(default_factory=dict)
    sync_threshold: float | None = None
    lag_s: float = 0.0
    lag_sd_s: float = 0.5e-3


@dataclass(frozen=True)
class LoadCell:
    """Conversion of /force to newtons: newtons = polarity × value × newtons_per_unit.

    For an amplifier newtons_per_unit is capacity_kg × g / full_scale_v, for an indicator that of its unit.
    The rest is its certificate: gain_relative_sd the standard uncertainty of its scale, dates as YYYY-MM-DD; "" or
    None if unknown. range_v is that of an amplifier's channel: beyond it, force is saturated. A trial whose zero
    drifts by more than zero_drift_relative_limit of the capacity is refused.
    """

    source: Literal["daq", "serial"]
    newtons_per_unit: float
    polarity: Literal[1, -1]
    serial_number: str = ""
    capacity_kg: float | None = None
    sensitivity_mv_per_v: float | None = None
    gain_relative_sd: float = 0.0
    calibrated_on: str = ""
    calibration_due_on: str = ""
    range_v: float = 10.0
    zero_drift_relative_limit: float = 0.02


@dataclass(frozen=True)
class Timing:
    """Lag of force against markers, and where the sync line falls, as the configuration declares them.

    lag_s        a force sample stamped t was taken at t + lag_s by the markers' clock
    lag_sd_s     its standard uncertainty, where no bounce trial measures it: amplifier, exposure and conversion
    stop_edge    where in the last frame the sync line falls; None where it is not declared
    exposure_s   of the cameras; needed for "end_of_exposure"
    """

    lag_s: float = 0.0
    lag_sd_s: float = 0.5e-3
    stop_edge: StopEdge | None = None
    exposure_s: float | None = None

    def __post_init__(self) -> None:
        if self.stop_edge == "end_of_exposure" and self.exposure_s is None:
            raise ValueError("stop_edge is end_of_exposure without exposure_s")


@dataclass(frozen=True)
class MeasurementProtocol:
    """The loading that was planned for a trial.

    step_masses_kg  weights of a static test in the order in which they are hung on; empty where they are not declared
    hold_s          shortest duration of a held load;  swing_s  shortest duration of a dynamic test; None: not declared
    pose_s          duration of a pose trial;  cycles  arm raises of a motion trial; None: not declared
    """

    step_masses_kg: tuple[float, ...] = ()
    hold_s: float | None = None
    swing_s: float | None = None
    pose_s: float | None = None
    cycles: int | None = None


@dataclass(frozen=True)
class Manifest:
    """One trial's passport.

    A static or dynamic test has a cuff, a bounce test has a bounce, a pose or motion trial has a body. A motion trial
    has a condition, too; a pose may have one. emg is None where no EMG is recorded.
    start_utc_ns is the host's UTC at arming; start is "sync_edge" or "pfi0" (then force sample 0 is the edge). Of an
    imported trial without a sync line it is "declared" (the clocks of two files were declared to agree at
    origin_s, session time 0) or "one_clock" (both streams are of one file and one clock).
    timing and protocol are, with load_cell and cuff, all that a fit takes from the configuration. effective_config is
    the whole configuration that was in force, as plain data, for audit and replay; versions maps package to version.
    devices is what every device reported; empty in imported recordings and in those of older stations.
    """

    cuff: CuffSite | None
    test: TestKind
    repeat: int
    run: int
    donning: str
    start: Literal["sync_edge", "pfi0", "declared", "one_clock"]
    sync_threshold_v: float
    load_cell: LoadCell
    start_utc_ns: int
    bounce: BounceRig | None = None
    origin_s: float = 0.0
    timing: Timing = Timing()
    protocol: MeasurementProtocol = MeasurementProtocol()
    effective_config: dict[str, Any] = field(default_factory=dict)
    versions: dict[str, str] = field(default_factory=dict)
    devices: tuple[DeviceIdentity, ...] = ()
    body: BodyMarkers | None = None
    condition: TrialCondition | None = None
    emg: EmgAmplifier | None = None

    @property
    def subject(self) -> TrialSubject | None:
        """Subject of the trial, with the markers that it needs; None where the manifest names nothing."""
        return self.cuff or self.bounce or self.body

    @property
    def origin(self) -> DataOrigin:
        """Measured or simulated, as reported by the devices."""
        return DataOrigin.of_devices(self.devices)

    @property
    def is_force_used(self) -> bool:
        """Whether the trial needs the load cell; one of the wearer does only where the cell is in the suit's cord."""
        return self.body is None or self.body.is_cord_measured

    @property
    def begins_at_edge(self) -> bool:
        """Whether session time 0 is the sync edge; otherwise it is origin_s on the device clocks."""
        return self.start in ("sync_edge", "pfi0")


@dataclass(frozen=True)
class TrialOutcome:
    """Outcome of a trial, and the proof that nothing before it is missing.

    state     where the session's state machine ended: "closed" or "failed"
    sentence  why, for a person;  codes  the same for programs, empty in older recordings
    messages  how many messages each topic holds before this one, by topic; counted by the writer
    samples   how many samples each stream holds, by stream; counted by the writer
    """

    accepted: bool
    state: str
    sentence: str
    messages: Mapping[str, int] = field(default_factory=dict)
    samples: Mapping[str, int] = field(default_factory=dict)
    codes: tuple[str, ...] = ()


def manifest_to_json(manifest: Manifest) -> str:
    """The manifest as one JSON object; numbers survive bit for bit."""
    return _adapter().dump_json(manifest).decode()


def manifest_from_json(text: str) -> Manifest:
    """The manifest back from JSON. Keys that a later version added are passed over; a missing one is an error."""
    try:
        manifest = _adapter().validate_python(parse_json(text))
    except PlainDataError as error:
        raise RecordingError(f"the manifest cannot be read: it {error}", RecordingCode.MANIFEST) from error
    except ValidationError as error:
        raise RecordingError(f"the manifest cannot be read: {describe_error(error)}", RecordingCode.MANIFEST) from error
    if not 0 <= manifest.start_utc_ns < 2**63:
        raise RecordingError(
            f"the manifest has a start_utc_ns of {manifest.start_utc_ns}, expected UTC in nanoseconds",
            RecordingCode.MANIFEST,
        )
    if manifest.cuff and not is_file_name(manifest.cuff.name):
        found = manifest.cuff.name[:60]
        raise RecordingError(
            f"the manifest's cuff is named {found!r}, expected no path: files are named after it",
            RecordingCode.MANIFEST,
        )
    return manifest


def is_file_name(name: object, *, may_be_empty: bool = False) -> bool:
    """Whether a text names a file in the folder that it is looked for in, on any operating system: no separator, no
    drive, no NUL and no line break.
    """
    if not isinstance(name, str) or len(name) > LONGEST_NAME:
        return False
    has_control = any(ord(character) < 32 or ord(character) == 127 for character in name)
    return (may_be_empty or name != "") and PureWindowsPath(name).name == name and not has_control


@cache
def _adapter() -> TypeAdapter[Manifest]:
    return TypeAdapter(Manifest)
