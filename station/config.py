"""Configuration of the station (station.toml) with all defaults; unknown keys are errors.

Labels of published marker sets come from marker_presets.toml, which gives the sources.
"""

from __future__ import annotations

import difflib
import re
import string
from collections.abc import Iterator
from dataclasses import MISSING, fields, is_dataclass
from datetime import date, timedelta
from functools import cache
from pathlib import Path
from typing import Annotated, Any, Literal, get_args, get_origin, get_type_hints

from pydantic import BaseModel, Field, ValidationError, field_validator, model_validator
from pydantic.fields import FieldInfo

from documents.message import Message, because
from documents.plain_data import PlainDataError, read_toml
from documents.validation import UNKNOWN_KEY, FiniteSection, Section, describe_error
from documents.validation import Positive as StrictPositive
from recordings.manifest import (
    BodyMarkers,
    BounceRig,
    CuffSite,
    LoadCell,
    MeasurementProtocol,
    StopEdge,
    Timing,
    TrialCondition,
    TrialSubject,
    is_file_name,
)
from recordings.standard_gravity import g
from station.body_config import AnalogSection, BodySection, EmgSection
from station.errors import StationError
from station.exit_code import WRONG_USAGE
from station.messages.setup_messages import ConfigCode
from station.protocol import BODY_TESTS, TrialSpec, windows_name_fault

DEVICE_LIMIT_HZ = 10_000.0  # the USB-6008 has one converter for all its channels
INDICATOR_UNITS_N = {"usb220": 4.4482216152605, "usb520": g * 1e-3}  # pounds-force and grams-force
PUBLISHED_SITES: dict[str, Literal["arm", "waist"]] = {"waist": "waist", "hand": "arm", "tube": "arm", "elbow": "arm"}
CEILING_PART_OF_CAPACITY = 0.8
CUFF_NAME = re.compile(r"[^\W_][\w-]*")
Positive = Annotated[float, Field(gt=0)]
NAME_FIELDS = ("subject", "session", "test", "cuff", "run")
NO_BODY = ("source", "markers")


class LiveSection(Section):
    """Live solution of pose and motion trials, and its outputs besides the views."""

    enabled: bool = False
    lag_s: float = Field(default=0.15, ge=0, le=0.2)  # of the smoother: more lag, more accurate (docs/live.md)
    highest_rate_hz: StrictPositive = 100.0  # frames per second that are solved; cameras that send more are decimated
    model: str = ""  # .osim; without it the wearer's body from the session's earlier trials, or the bundled one
    suit: Path | None = None  # suit.toml; without it the bundled suit
    cuffs: Path | None = None  # without it cuffs.json of the session; without both only rigid cuffs
    arm_cuff: str = ""  # that is worn; without it that of subject.toml, else the only one fitted
    other_cuff: str = ""  # a further scenario
    rest_length_m: StrictPositive | None = None  # without it that of subject.toml, or the suit's reference
    rest_lengths_m: tuple[StrictPositive, ...] = Field(
        default=(), max_length=4
    )  # further scenarios, for the best length
    writes_file: bool = True  # live/TRIAL.live.csv in the session's folder
    outlet: str = ""  # a Lab Streaming Layer outlet: "loopback", a network interface such as "eth0", or "any"
    outlet_name: Annotated[str, Field(min_length=1)] = "cuffstation live"

    def without_cuffs(self) -> LiveSection:
        """The same with rigid cuffs only."""
        return self.model_copy(update={"cuffs": None, "arm_cuff": "", "other_cuff": ""})


class ConfigError(StationError):
    """The configuration cannot be used; the sentence has file, key, expected and found value."""

    exit_code = WRONG_USAGE


class DaqSection(FiniteSection):
    device: str = "Dev1"
    grpc_target: str | None = None
    force_channel: str = "ai0"
    sync_channel: str = "ai1"
    force_range_v: Positive = 10.0
    sync_range_v: Positive = 10.0
    sample_rate_hz: Positive = 1000.0
    start: Literal["sync_edge", "pfi0"] = "sync_edge"


class LoadCellSection(FiniteSection):
    source: Literal["daq", "serial"] = "daq"
    capacity_kg: Positive = 50.0
    full_scale_v: Positive = 5.0
    polarity: Literal[1, -1] = 1
    serial_number: str = ""
    sensitivity_mv_per_v: Positive | None = None  # this and the next four: from the certificate
    gain_relative_sd: float = Field(default=0.0, ge=0)  # standard uncertainty of the scale
    calibrated_on: date | None = None
    calibration_due_on: date | None = None  # default: calibration_valid_days after it
    calibration_valid_days: int = Field(default=365, gt=0, le=36_500)
    zero_drift_relative_limit: Positive = 0.02  # of the capacity: a trial whose zero drifts further is refused
    port: str | None = None
    baud_rate: int = Field(default=9600, gt=0, le=10_000_000)
    line_format: Literal["usb220", "usb520"] = "usb220"

    @property
    def capacity_n(self) -> float:
        return self.capacity_kg * g

    @property
    def due_on(self) -> date | None:
        """Day on which the calibration expires; None for an unknown date of calibration."""
        if self.calibration_due_on is not None or self.calibrated_on is None:
            return self.calibration_due_on
        left = (date.max - self.calibrated_on).days
        return self.calibrated_on + timedelta(days=min(self.calibration_valid_days, left))

    @model_validator(mode="after")
    def _serial_needs_a_port(self) -> LoadCellSection:
        if self.source == "serial" and not self.port:
            raise ValueError('source is "serial" and no port is given; add port = "COM3" or "/dev/ttyUSB0"')
        return self


class SyncSection(FiniteSection):
    threshold_v: float = 2.5
    timeout_s: Positive = 60.0
    lag_s: float = 0.0  # a force sample stamped t was taken at t + lag_s by the markers' clock
    lag_sd_s: float = Field(default=0.0005, ge=0)  # its standard uncertainty, where no bounce trial measures it
    stop_edge: StopEdge | None = None  # None: not known; see docs/wiring.md
    exposure_s: Positive | None = None  # of the mocap cameras, for "end_of_exposure"

    @model_validator(mode="after")
    def _exposure_is_given_with_its_end(self) -> SyncSection:
        if self.stop_edge == "end_of_exposure" and self.exposure_s is None:
            raise ValueError('stop_edge is "end_of_exposure" and no exposure_s is given; add the exposure time of QTM')
        return self


class MocapSection(FiniteSection):
    host: str = "127.0.0.1"
    port: int = Field(default=22223, ge=0, le=65_535)
    control: Literal["none", "start"] = "none"
    password: str = ""


class CuffSection(FiniteSection):
    """The markers of one cuff. anchor_preset, with label_prefix, stands for anchor_markers (marker_presets.toml)."""

    site: Literal["arm", "waist"]
    anchor_markers: tuple[str, ...]
    cuff_markers: tuple[str, ...] = Field(min_length=1)
    rope_markers: tuple[str, ...] = ()
    mass_kg: float = Field(default=0.2, ge=0)

    @model_validator(mode="before")
    @classmethod
    def _preset_names_the_anchor(cls, data: Any) -> Any:
        if not isinstance(data, dict) or "anchor_preset" not in data:
            return data
        if "anchor_markers" in data:
            raise ValueError("anchor_markers and anchor_preset are both given; leave one of them out")
        labels = preset_labels(str(data["anchor_preset"]), str(data.get("label_prefix", "")))
        others = {key: value for key, value in data.items() if key not in ("anchor_preset", "label_prefix")}
        return {**others, "anchor_markers": labels}

    @field_validator("anchor_markers")
    @classmethod
    def _anchor_is_a_body(cls, labels: tuple[str, ...]) -> tuple[str, ...]:
        if len(set(labels)) < 3:
            raise ValueError(
                f"{len(set(labels))} marker(s), expected at least 3 that are not in a line: fewer do not define the "
                "rotation of the anchoring body; add one near shoulder and elbow"
            )
        return labels


class ProtocolSection(FiniteSection):
    """The published plan: static, dynamic and a pause, three times, every cuff donned once.

    step_masses_kg: weights of a static test in the order of loading; the fit compares every load step with them.
    """

    step_masses_kg: tuple[Positive, ...] = ()
    repeats: int = Field(default=3, ge=1, le=1000)
    pause_s: float = Field(default=60.0, ge=0)
    hold_s: Positive = 7.0  # least duration of every load of a static test
    swing_s: Positive = 20.0  # least duration of a dynamic test


class SafetySection(FiniteSection):
    """Limits of the alarms of the console: force at the cuff [N] and its rate [N/s].

    The force ceiling is at most 80 % of the capacity of the load cell.
    """

    force_ceiling_n: Positive = 150.0
    force_rate_ceiling_n_per_s: Positive = 500.0


class SessionSection(FiniteSection):
    """Folders and file names of sessions: one folder per subject and session."""

    folder: Path = Path("sessions")
    file_name: str = "sub-{subject}_ses-{session}_task-{test}_acq-{cuff}_run-{run}"

    @field_validator("file_name")
    @classmethod
    def _names_are_unique(cls, template: str) -> str:
        try:
            parts = list(string.Formatter().parse(template))
        except ValueError as error:
            raise ValueError(
                f"{template!r} contains {error}; the fields are {', '.join(NAME_FIELDS)}, in braces"
            ) from error
        for _, field, width, conversion in parts:  # a width of 2e9 would be applied
            if field is not None and (field not in NAME_FIELDS or width or conversion):
                raise ValueError(
                    f"{template!r} contains {field!r}; the fields are {', '.join(NAME_FIELDS)}, in braces alone"
                )
        needed = {"test", "cuff", "run"} - {field for _, field, _, _ in parts}
        if needed or not is_file_name(template):
            raise ValueError(
                f"{template!r} must contain {{test}}, {{cuff}}, {{run}} and no folder, so that names are unique"
            )
        if fault := windows_name_fault(template):
            raise ValueError(f"{template!r} {fault}; sessions move between computers")
        return template


class StationConfig(FiniteSection):
    daq: DaqSection = DaqSection()
    load_cell: LoadCellSection = LoadCellSection()
    sync: SyncSection = SyncSection()
    mocap: MocapSection = MocapSection()
    cuffs: dict[str, CuffSection] = Field(default_factory=dict)
    protocol: ProtocolSection = ProtocolSection()
    bounce: BounceRig | None = None
    body: BodySection | None = None
    emg: EmgSection | None = None
    analog: dict[str, AnalogSection] = Field(default_factory=dict)
    live: LiveSection = LiveSection()
    safety: SafetySection = SafetySection()
    session: SessionSection = SessionSection()
    simulation: dict[str, Any] = Field(default_factory=dict)  # validated by the simulators

    @field_validator("cuffs")
    @classmethod
    def _names_fit_into_file_names(cls, cuffs: dict[str, CuffSection]) -> dict[str, CuffSection]:
        for name in cuffs:
            if not CUFF_NAME.fullmatch(name):
                raise ValueError(
                    f"{name!r} is not a name for a cuff, expected letters, digits, - and _, as it is part of file names"
                )
        same = [name for name in cuffs if sum(name.casefold() == other.casefold() for other in cuffs) > 1]
        if same:
            raise ValueError(
                f"{' and '.join(same)} differ in case only: their files have the same name on Windows and macOS"
            )
        return cuffs

    @model_validator(mode="before")
    @classmethod
    def _published_cuffs_have_a_site(cls, data: Any) -> Any:
        if not isinstance(data, dict) or not isinstance(data.get("cuffs"), dict):
            return data
        cuffs = {
            name: {"site": PUBLISHED_SITES[name], **cuff}
            if name in PUBLISHED_SITES and isinstance(cuff, dict)
            else cuff
            for name, cuff in data["cuffs"].items()
        }
        return {**data, "cuffs": cuffs}

    @property
    def daq_inputs(self) -> list[str]:
        """Inputs of the DAQ that a pose or motion trial reads; the pull of a cuff reads the first two."""
        force = [self.daq.force_channel] if self.load_cell.source == "daq" else []
        emg = [channel.input for channel in self.emg.daq_channels.values()] if self.emg else []
        return [*force, self.daq.sync_channel, *emg, *(section.input for section in self.analog.values())]

    @model_validator(mode="after")
    def _inputs_are_wired_once(self) -> StationConfig:
        twice = sorted({name for name in self.daq_inputs if self.daq_inputs.count(name) > 1})
        if twice:
            raise ValueError(
                f"the DAQ input {', '.join(twice)} is given to two signals; give another input to one of them"
            )
        return self

    @model_validator(mode="after")
    def _device_keeps_up(self) -> StationConfig:
        channels = len(self.daq_inputs)
        if self.daq.sample_rate_hz * channels > DEVICE_LIMIT_HZ:
            raise ValueError(
                f"daq.sample_rate_hz is {self.daq.sample_rate_hz:g} on {channels} channel(s), expected at most "
                f"{DEVICE_LIMIT_HZ / channels:g}: the USB-6008 converts {DEVICE_LIMIT_HZ:g} samples per second in total"
            )
        return self

    @property
    def force_ceiling_n(self) -> float:
        """Force limit [N] of cuff and load cell."""
        return min(self.safety.force_ceiling_n, CEILING_PART_OF_CAPACITY * self.load_cell.capacity_n)

    def cuff_site(self, name: str) -> CuffSite:
        """The markers of one cuff. Raises ConfigError if the file has no section for it."""
        if name not in self.cuffs:
            known = ", ".join(sorted(self.cuffs)) or "none"
            raise ConfigError(Message(ConfigCode.UNKNOWN_CUFF, {"name": name, "known": known}))
        cuff = self.cuffs[name]
        return CuffSite(name, cuff.site, cuff.anchor_markers, cuff.cuff_markers, cuff.rope_markers, cuff.mass_kg)

    def subject(self, spec: TrialSpec) -> TrialSubject:
        """Subject of a trial: cuff, bouncing weight or wearer. Raises ConfigError if its section is missing."""
        if spec.cuff is not None:
            return self.cuff_site(spec.cuff)
        if spec.test in BODY_TESTS:
            return self.body_markers(spec.condition)
        if self.bounce is None:
            raise ConfigError(Message(ConfigCode.NO_BOUNCE))
        return self.bounce

    def body_markers(self, condition: TrialCondition | None) -> BodyMarkers:
        """Markers of the wearer. Raises ConfigError if the section is missing."""
        if self.body is None:
            raise ConfigError(Message(ConfigCode.NO_BODY))
        return self.body.markers_in(condition)

    def calibration(self) -> LoadCell:
        """Calibration of the load cell."""
        cell = self.load_cell
        scale = (
            cell.capacity_kg * g / cell.full_scale_v if cell.source == "daq" else INDICATOR_UNITS_N[cell.line_format]
        )
        return LoadCell(
            cell.source,
            scale,
            cell.polarity,
            cell.serial_number,
            cell.capacity_kg,
            cell.sensitivity_mv_per_v,
            cell.gain_relative_sd,
            str(cell.calibrated_on or ""),
            str(cell.due_on or ""),
            self.daq.force_range_v,
            cell.zero_drift_relative_limit,
        )

    def timing(self) -> Timing:
        """Declared lag between force and markers, and stop edge."""
        sync = self.sync
        return Timing(sync.lag_s, sync.lag_sd_s, sync.stop_edge, sync.exposure_s)

    def measurement_protocol(self) -> MeasurementProtocol:
        """The loading that is planned for a trial."""
        plan, body = self.protocol, self.body
        pose_s, cycles = (body.pose_s, body.cycles) if body else (None, None)
        return MeasurementProtocol(plan.step_masses_kg, plan.hold_s, plan.swing_s, pose_s, cycles)


def load_config(path: Path) -> StationConfig:
    """Read station.toml. Raises ConfigError."""
    try:
        data = read_toml(path)
    except FileNotFoundError as error:
        raise ConfigError(Message(ConfigCode.MISSING, {"path": str(path)})) from error
    except OSError as error:
        raise ConfigError(Message(ConfigCode.UNREADABLE, {"path": str(path), **because(error)})) from error
    except PlainDataError as error:
        raise ConfigError(Message(ConfigCode.WRONG_SYNTAX, {"path": str(path), **because(error)})) from error
    return parse_config(data, str(path))


def parse_config(data: dict[str, Any], origin: str) -> StationConfig:
    """Validate a configuration; origin: its file, for messages. Raises ConfigError."""
    try:
        return StationConfig.model_validate(data)
    except ValidationError as error:
        first, figures = error.errors()[0], {"path": origin, "reason": describe_error(error)}
        if first["type"] in UNKNOWN_KEY:
            figures["advice"] = _advice(str(first["loc"][-1]))
            raise ConfigError(Message(ConfigCode.UNKNOWN_KEY, figures)) from error
        raise ConfigError(Message(ConfigCode.WRONG_VALUE, figures)) from error


def _advice(unknown: str) -> str:
    near = difflib.get_close_matches(unknown, nested_keys(StationConfig), 1)
    return f"did you mean {near[0]}?" if near else "the example station.toml has every key"


def nested_keys(section: type[Any]) -> list[str]:
    """The names of all keys, including those of nested sections."""
    return [key for part in (section, *(inner for _, inner in walk_sections(section))) for key in section_fields(part)]


def walk_sections(section: type[Any], within: str = "") -> Iterator[tuple[str, type[Any]]]:
    """Name, as cuffs.NAME, and type of every section in one, at any depth."""
    for key, field in section_fields(section).items():
        for part in (field.annotation, *get_args(field.annotation)):
            if isinstance(part, type) and (issubclass(part, BaseModel) or is_dataclass(part)):
                name = f"{within}{key}" + (".NAME" if get_origin(field.annotation) is dict else "")
                yield name, part
                yield from walk_sections(part, f"{name}.")


def section_fields(section: type[Any]) -> dict[str, FieldInfo]:
    """Key → field of a section, which is a model or a dataclass of the recordings."""
    if issubclass(section, BaseModel):
        return section.model_fields
    types = get_type_hints(section, include_extras=True)
    return {
        one.name: FieldInfo.from_annotation(types[one.name])
        if one.default is MISSING
        else FieldInfo.from_annotated_attribute(types[one.name], one.default)
        for one in fields(section)
    }


def preset_labels(name: str, prefix: str = "") -> tuple[str, ...]:
    """The labels of a body, such as "qualisys_sports.left_arm", with the prefix. Raises ValueError for another name.

    The labels of a skeleton in QTM start with the name of the person, for example "Anna_".
    """
    known = {
        f"{marker_set}.{body}": labels for marker_set, bodies in _presets().items() for body, labels in bodies.items()
    }
    if name not in known or name.rpartition(".")[2] in NO_BODY:
        bodies = ", ".join(body for body in known if body.rpartition(".")[2] not in NO_BODY)
        raise ValueError(f"{name!r} is not a preset, expected one of {bodies}")
    return tuple(prefix + label for label in known[name])


@cache
def _presets() -> dict[str, dict[str, Any]]:
    import tomllib  # for the few who use a preset

    return tomllib.loads(Path(__file__).with_name("marker_presets.toml").read_text(encoding="utf-8"))
