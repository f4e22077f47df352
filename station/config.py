"""station.toml → StationConfig: frozen, every default on this page, unknown keys refused."""

from __future__ import annotations

import difflib
import re
import string
from datetime import date, timedelta
from pathlib import Path
from typing import Annotated, Any, Literal, get_args

from pydantic import BaseModel, ConfigDict, Field, ValidationError, field_validator, model_validator
from scipy.constants import g

from documents.plain_data import PlainDataError, read_toml
from documents.validation import describe_error
from recordings.manifest import (
    BounceRig,
    CuffSite,
    LoadCell,
    MeasurementProtocol,
    StopEdge,
    Timing,
    is_file_name,
)
from station.errors import StationError
from station.exit_code import WRONG_USAGE
from station.marker_presets import preset_labels
from station.windows_names import why_no_windows_name

DEVICE_LIMIT_HZ = 10_000.0  # the USB-6008 has one converter for all its channels
INDICATOR_UNITS_N = {"usb220": 4.4482216152605, "usb520": g * 1e-3}  # pounds-force and grams-force
PUBLISHED_SITES: dict[str, Literal["arm", "waist"]] = {"waist": "waist", "hand": "arm", "tube": "arm", "elbow": "arm"}

CEILING_PART_OF_CAPACITY = 0.8
CUFF_NAME = re.compile(r"[^\W_][\w-]*")
Positive = Annotated[float, Field(gt=0)]


class ConfigError(StationError):
    """The configuration cannot be used; one sentence names file, key, expected and found."""

    exit_code = WRONG_USAGE


class _Section(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True)


class DaqSection(_Section):
    device: str = "Dev1"
    grpc_target: str | None = None
    force_channel: str = "ai0"
    sync_channel: str = "ai1"
    force_range_v: Positive = 10.0
    sync_range_v: Positive = 10.0
    sample_rate_hz: Positive = 1000.0
    start: Literal["sync_edge", "pfi0"] = "sync_edge"


class LoadCellSection(_Section):
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
        """The day from which the calibration is no longer current; None where nobody said when it was."""
        if self.calibration_due_on is not None or self.calibrated_on is None:
            return self.calibration_due_on
        left = (date.max - self.calibrated_on).days
        return self.calibrated_on + timedelta(days=min(self.calibration_valid_days, left))

    @model_validator(mode="after")
    def _serial_needs_a_port(self) -> LoadCellSection:
        if self.source == "serial" and not self.port:
            raise ValueError('source is "serial" and no port is given; add port = "COM3" or "/dev/ttyUSB0"')
        return self


class SyncSection(_Section):
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


class MocapSection(_Section):
    host: str = "127.0.0.1"
    port: int = Field(default=22223, ge=0, le=65_535)
    control: Literal["none", "start"] = "none"
    password: str = ""


class CuffSection(_Section):
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
        rest = {key: value for key, value in data.items() if key not in ("anchor_preset", "label_prefix")}
        return {**rest, "anchor_markers": labels}

    @field_validator("anchor_markers")
    @classmethod
    def _anchor_is_a_body(cls, labels: tuple[str, ...]) -> tuple[str, ...]:
        if len(set(labels)) < 3:
            raise ValueError(
                f"{len(set(labels))} marker(s), expected at least 3 that are not in a line: fewer do not tell how the "
                "anchoring body turns; add one beside shoulder and elbow"
            )
        return labels


class BounceSection(_Section):
    """The weight on a steel spring that calibrates the load cell, and the marker on the weight."""

    mass_kg: Positive
    marker: str = Field(min_length=1)
    spring_mass_kg: float = Field(default=0.0, ge=0)
    mass_relative_sd: float = Field(default=0.0005, ge=0)


class ProtocolSection(_Section):
    """The published plan: static, dynamic, a pause, three times over, each cuff donned once.

    step_masses_kg are the weights of a static test in the order they are hung on; the fit checks every step against it.
    """

    step_masses_kg: tuple[Positive, ...] = ()
    repeats: int = Field(default=3, ge=1, le=1000)
    pause_s: float = Field(default=60.0, ge=0)
    hold_s: Positive = 7.0  # each load of a static test, at least
    swing_s: Positive = 20.0  # a dynamic test, at least


class SafetySection(_Section):
    """What the console stops at, loudly: newtons at the cuff, and newtons a second.

    The force ceiling is never above 80 % of the load cell's capacity.
    """

    force_ceiling_n: Positive = 150.0
    force_rate_ceiling_n_per_s: Positive = 500.0


NAME_FIELDS = ("subject", "session", "test", "cuff", "run")


class SessionSection(_Section):
    """What the console records into: a folder for each subject and session, and the names of the files in it."""

    folder: Path = Path("sessions")
    file_name: str = "sub-{subject}_ses-{session}_task-{test}_acq-{cuff}_run-{run}"

    @field_validator("file_name")
    @classmethod
    def _names_are_told_apart(cls, template: str) -> str:
        try:
            parts = list(string.Formatter().parse(template))
        except ValueError as error:
            raise ValueError(
                f"{template!r} holds {error}; the fields are {', '.join(NAME_FIELDS)}, in braces"
            ) from error
        for _, field, width, conversion in parts:  # a width of two thousand million would be taken at its word
            if field is not None and (field not in NAME_FIELDS or width or conversion):
                raise ValueError(
                    f"{template!r} holds {field!r}; the fields are {', '.join(NAME_FIELDS)}, in braces alone"
                )
        needed = {"test", "cuff", "run"} - {field for _, field, _, _ in parts}
        if needed or not is_file_name(template):
            raise ValueError(
                f"{template!r} must hold {{test}}, {{cuff}}, {{run}} and no folder: no two trials may share a name"
            )
        if why := why_no_windows_name(template):
            raise ValueError(f"{template!r} {why}; sessions move between computers")
        return template


class StationConfig(_Section):
    daq: DaqSection = DaqSection()
    load_cell: LoadCellSection = LoadCellSection()
    sync: SyncSection = SyncSection()
    mocap: MocapSection = MocapSection()
    cuffs: dict[str, CuffSection] = Field(default_factory=dict)
    protocol: ProtocolSection = ProtocolSection()
    bounce: BounceSection | None = None
    safety: SafetySection = SafetySection()
    session: SessionSection = SessionSection()
    simulation: dict[str, Any] = Field(default_factory=dict)  # checked by the simulators, who own its meaning

    @field_validator("cuffs")
    @classmethod
    def _names_fit_into_file_names(cls, cuffs: dict[str, CuffSection]) -> dict[str, CuffSection]:
        for name in cuffs:
            if not CUFF_NAME.fullmatch(name):
                raise ValueError(f"{name!r} is no cuff's name, expected letters, digits, - and _: files are named so")
        same = [name for name in cuffs if sum(name.casefold() == other.casefold() for other in cuffs) > 1]
        if same:
            raise ValueError(
                f"{' and '.join(same)} differ in case alone: Windows and macOS take their files for the same"
            )
        return cuffs

    @model_validator(mode="before")
    @classmethod
    def _published_cuffs_know_their_site(cls, data: Any) -> Any:
        if not isinstance(data, dict) or not isinstance(data.get("cuffs"), dict):
            return data
        cuffs = {
            name: {"site": PUBLISHED_SITES[name], **cuff}
            if name in PUBLISHED_SITES and isinstance(cuff, dict)
            else cuff
            for name, cuff in data["cuffs"].items()
        }
        return {**data, "cuffs": cuffs}

    @model_validator(mode="after")
    def _device_keeps_up(self) -> StationConfig:
        channels = 2 if self.load_cell.source == "daq" else 1
        if self.daq.sample_rate_hz * channels > DEVICE_LIMIT_HZ:
            raise ValueError(
                f"daq.sample_rate_hz is {self.daq.sample_rate_hz:g} on {channels} channel(s), expected at most "
                f"{DEVICE_LIMIT_HZ / channels:g}: the USB-6008 converts {DEVICE_LIMIT_HZ:g} samples a second in all"
            )
        return self

    @property
    def force_ceiling_n(self) -> float:
        """[N] that neither a cuff on a person nor the load cell may see."""
        return min(self.safety.force_ceiling_n, CEILING_PART_OF_CAPACITY * self.load_cell.capacity_n)

    def cuff_site(self, name: str) -> CuffSite:
        """The markers of one cuff. Raises ConfigError if the file has no section for it."""
        if name not in self.cuffs:
            known = ", ".join(sorted(self.cuffs)) or "none"
            raise ConfigError(
                f"the configuration has no cuff {name!r}, only {known}; add [cuffs.{name}] with its anchor_markers "
                "and cuff_markers"
            )
        cuff = self.cuffs[name]
        return CuffSite(name, cuff.site, cuff.anchor_markers, cuff.cuff_markers, cuff.rope_markers, cuff.mass_kg)

    def subject(self, cuff: str | None) -> CuffSite | BounceRig:
        """What a trial is of: a cuff, or without one the bouncing weight. Raises ConfigError if it has no section."""
        if cuff is not None:
            return self.cuff_site(cuff)
        if self.bounce is None:
            raise ConfigError(
                "the configuration has no [bounce], expected the weight's mass_kg and the marker on it; add the "
                "section to record a bounce trial"
            )
        return BounceRig(**self.bounce.model_dump())

    def calibration(self) -> LoadCell:
        """How the recorded force becomes newtons."""
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
        """Lag of force against markers and the stop edge, as declared."""
        sync = self.sync
        return Timing(sync.lag_s, sync.lag_sd_s, sync.stop_edge, sync.exposure_s)

    def measurement_protocol(self) -> MeasurementProtocol:
        """The loading that is planned for a trial."""
        plan = self.protocol
        return MeasurementProtocol(plan.step_masses_kg, plan.hold_s, plan.swing_s)


def load_config(path: Path) -> StationConfig:
    """Reads station.toml. Raises ConfigError in one sentence."""
    try:
        data = read_toml(path)
    except OSError as error:
        raise ConfigError(f"cannot read the configuration {path}: {error.strerror}") from error
    except PlainDataError as error:
        raise ConfigError(f"{path} {error}") from error
    return parse_config(data, str(path))


def parse_config(data: dict[str, Any], origin: str) -> StationConfig:
    """Plain data → StationConfig; origin is named in the sentence of a ConfigError."""
    try:
        return StationConfig.model_validate(data)
    except ValidationError as error:
        first = error.errors()[0]
        advice = _advice(str(first["loc"][-1])) if first["type"] == "extra_forbidden" else ""
        raise ConfigError(f"{origin}: {describe_error(error)}{advice}") from error


def _advice(unknown: str) -> str:
    near = difflib.get_close_matches(unknown, keys_of(StationConfig), 1)
    return f"; did you mean {near[0]}?" if near else "; the example station.toml names every key"


def keys_of(section: type[BaseModel]) -> list[str]:
    """The names of all keys, those of sections within it too."""
    names = list(section.model_fields)
    for field in section.model_fields.values():
        for part in (field.annotation, *get_args(field.annotation)):
            if isinstance(part, type) and issubclass(part, BaseModel):
                names += keys_of(part)
    return names
