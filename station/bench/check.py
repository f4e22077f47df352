"""Check the bench: devices, rates, force at rest and calibration, level of the sync line, labels, disk space.

A known mass checks the load cell before and after a session, and the reading is kept: `station check --known-mass 0`
reads the empty cell, `--known-mass 2` two kilograms on it; a shunt is entered as the mass that it represents. The fit
of the session uses the readings (fitting/trial/mass_checks.py).
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from datetime import UTC, date, datetime
from pathlib import Path
from queue import Empty
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from numpy.typing import NDArray

from documents.message import Figures, Message, because
from fitting.results.codes import FitErrorCode
from fitting.trial.calibration import full_scale
from fitting.trial.mass_checks import CHECKS_FILE, MassCheck, MassCheckError, evaluate_reading, read_checks
from recordings.samples import DeviceIdentity, Event, Samples, Stream
from station.bench.devices import devices_for, load_cell_for
from station.bench.feed import DeviceFailed, DeviceFeed, DeviceOpened, FeedMessage, FeedQueue
from station.bench.session_folder import bytes_free, bytes_needed
from station.bench.trial_recorder import MakeDevices
from station.clock import Clock, RealClock
from station.config import StationConfig
from station.journal import append_line, utc_now
from station.messages.bench_messages import CheckCode
from station.progress import busy

if TYPE_CHECKING:
    from rich.console import Console

REST_PART_OF_CAPACITY = 0.02
"""Largest force with an empty hook, as a fraction of the capacity; as much as the zero may drift within a trial."""
RATE_TOLERANCE = 0.1
SATURATION = 0.99
"""Fraction of full scale from which a reading counts as saturated."""
GRADES = {"good": "[green]ok[/]", "doubtful": "[yellow]?[/]", "bad": "[red]no[/]"}
OPEN_S = 15.0
"""Wall seconds for all devices to open: longer than a driver waits for a device that is off. Loading NI's library alone
took 3 s under Wine on a busy computer."""
LISTEN_S = 1.5
LISTEN_TO_MASS_S = 3.0


@dataclass(frozen=True)
class CheckResult:
    """One line of the check: subject, result, and whether it is as expected.

    is_doubtful: no fault is known, but the subject could not be checked or may be wrong.
    """

    subject: str
    message: Message[CheckCode]
    is_good: bool = field(kw_only=True)
    is_doubtful: bool = field(default=False, kw_only=True)

    @property
    def grade(self) -> Literal["good", "doubtful", "bad"]:
        """good only if it was checked and no fault was found."""
        return "bad" if not self.is_good else "doubtful" if self.is_doubtful else "good"

    @property
    def found(self) -> str:
        return str(self.message)

    def to_json(self) -> dict[str, Any]:
        return {
            "subject": self.subject,
            "is_good": self.is_good,
            "found": self.found,
            "is_doubtful": self.is_doubtful,
            "code": self.message.codes[-1],
            "figures": dict(self.message.figures),
        }


class DeviceSurvey:
    """Streams, rates and values of the devices while the check reads them."""

    def __init__(self) -> None:
        self.errors: dict[str, Message[CheckCode]] = {}  # by device
        self._streams_of: dict[str, list[str]] = {}
        self.unreadable: dict[str, str] = {}  # what a device sent instead of samples
        self.streams: dict[str, Stream] = {}
        self.identities: dict[str, DeviceIdentity] = {}
        self._count: dict[str, int] = {}
        self._span_ns: dict[str, tuple[int, int]] = {}
        self._last_value: dict[str, float] = {}
        self._force: list[NDArray[np.float64]] = []

    def handle(self, message: FeedMessage) -> None:
        if isinstance(message, DeviceFailed):
            self.errors[message.device] = Message(CheckCode.DEVICE_ERROR, because(message.error))
        elif isinstance(message, DeviceOpened):
            self.streams |= {stream.name: stream for stream in message.streams}
            self._streams_of[message.device] = [stream.name for stream in message.streams]
            self.identities[message.device] = message.identity
        else:
            for item in message.items:
                if isinstance(item, Samples) and len(item.values):
                    self._add(item)
                elif isinstance(item, Event) and item.kind.startswith("unreadable"):
                    self.unreadable[message.device] = item.text

    def is_silent(self, device: str) -> bool:
        """Whether the device has sent no sample."""
        return not any(name in self._count for name in self._streams_of.get(device, ()))

    def rate_hz(self, stream: str) -> float:
        """Samples per second of the device's own clock."""
        first, last = self._span_ns.get(stream, (0, 0))
        return (self._count[stream] - 1) / ((last - first) * 1e-9) if last > first else 0.0

    def force(self) -> NDArray[np.float64]:
        """(n,) all samples of /force, in the unit of its device."""
        return np.concatenate([np.zeros(0), *self._force])

    def last_value(self, stream: str) -> float | None:
        return self._last_value.get(stream)

    def _add(self, samples: Samples) -> None:
        first = self._span_ns.get(samples.stream, (int(samples.device_time_ns[0]), 0))[0]
        self._span_ns[samples.stream] = first, int(samples.device_time_ns[-1])
        self._count[samples.stream] = self._count.get(samples.stream, 0) + len(samples.values)
        self._last_value[samples.stream] = float(samples.values[-1].flat[0])
        if samples.stream == "/force":
            self._force.append(samples.values[:, 0].astype(np.float64))


def check_bench(config: StationConfig, folder: Path, *, as_json: bool) -> int:
    """Print the results, including the space on the folder's disk; return 0 if all are good, else 1."""
    with busy("reading the devices"):
        results = inspect_bench(config, folder)
    return show_results(results, as_json=as_json)


def show_results(results: Sequence[CheckResult], console: Console | None = None, *, as_json: bool = False) -> int:
    """Print them; return 0 if all are good, else 1."""
    if as_json:
        print(json.dumps([result.to_json() for result in results], indent=2, ensure_ascii=False))
    else:
        from rich.console import Console  # the browser's console shows them itself
        from rich.table import Table
        from rich.text import Text

        table = Table("", "subject", "result")
        for result in results:
            # As Text: a code in brackets is no markup.
            table.add_row(GRADES[result.grade], Text(result.subject), Text(result.found))
        (console or Console()).print(table)
    return 0 if all(result.is_good for result in results) else 1


def inspect_bench(config: StationConfig, folder: Path, make_devices: MakeDevices = devices_for) -> list[CheckResult]:
    """Open the devices, read them for LISTEN_S and compare what they send with the configuration."""
    return compare(*survey_devices(config, folder, RealClock(), make_devices), config, folder)


def compare(survey: DeviceSurvey, devices: Sequence[str], config: StationConfig, folder: Path) -> list[CheckResult]:
    """Comparison of the devices' samples with the configuration."""
    return [
        *(check_device(survey, device) for device in devices),
        *(_check_rate(survey, stream) for stream in survey.streams.values()),
        *_check_force(survey, config),
        check_calibration(config, datetime.now(UTC).date()),
        *_check_sync(survey, config),
        *_check_labels(survey, config),
        _check_disk(folder, bytes_needed(survey.streams.values(), config, folder, None)),
    ]


def check_calibration(config: StationConfig, today: date) -> CheckResult:
    """Age of the load cell's calibration, and whether it is still valid."""
    cell, subject = config.load_cell, "calibration of the load cell"
    if cell.calibrated_on is None or cell.due_on is None:
        return CheckResult(subject, Message(CheckCode.CALIBRATION_UNKNOWN), is_good=True, is_doubtful=True)
    age = (today - cell.calibrated_on).days
    figures: Figures = {
        "serial_number": f"of {cell.serial_number} " if cell.serial_number else "",
        "calibrated_on": str(cell.calibrated_on),
        "age_days": age,
        "due_on": str(cell.due_on),
    }
    code = CheckCode.CALIBRATION_VALID if today < cell.due_on else CheckCode.CALIBRATION_DUE
    code = CheckCode.CALIBRATION_IN_FUTURE if age < 0 else code
    return CheckResult(subject, Message(code, figures), is_good=code is CheckCode.CALIBRATION_VALID)


def survey_devices(
    config: StationConfig, folder: Path, clock: Clock, make_devices: MakeDevices, listen_s: float = LISTEN_S
) -> tuple[DeviceSurvey, list[str]]:
    """Read all devices for listen_s wall seconds after the last of them has opened; also the names of the devices."""
    inbox, survey = FeedQueue(), DeviceSurvey()
    feeds = [DeviceFeed(device, inbox) for device in make_devices(config, None, clock, folder)]
    for feed in feeds:
        feed.start()
    answered: set[str] = set()
    open_timeout_s = OPEN_S * clock.timeout_scale
    open_until, listen_until = clock.wall_s() + open_timeout_s, float("inf")
    while feeds and clock.wall_s() < min(open_until, listen_until):
        try:
            message = inbox.get(timeout=0.05)
        except Empty:
            continue
        survey.handle(message)
        answered.add(message.device)
        if len(answered) == len(feeds) and listen_until == float("inf"):
            listen_until = clock.wall_s() + listen_s
            open_until = listen_until
    for feed in feeds:
        feed.ask_to_stop()
    for feed in feeds:
        feed.has_ended(1.0)
        if feed.device.name not in answered:
            figures: Figures = {"device": feed.device.name, "timeout_s": open_timeout_s}
            survey.errors[feed.device.name] = Message(CheckCode.NO_ANSWER, figures)
    return survey, [feed.device.name for feed in feeds]


def check_device(survey: DeviceSurvey, device: str) -> CheckResult:
    """Whether the device answers, and how it identifies itself."""
    if device in survey.errors:
        return CheckResult(device, survey.errors[device], is_good=False)
    if device in survey.unreadable and survey.is_silent(device):
        message = Message(CheckCode.UNREADABLE, because(survey.unreadable[device]))
        return CheckResult(device, message, is_good=False)
    identity = survey.identities.get(device)
    text = f": {identity.text}" if identity is not None and identity.text else ""
    is_simulated = identity is not None and identity.is_simulated
    code = CheckCode.ANSWERS_SIMULATED if is_simulated else CheckCode.ANSWERS
    return CheckResult(device, Message(code, {"identity": text}), is_good=True)


def _check_rate(survey: DeviceSurvey, stream: Stream) -> CheckResult:
    rate = survey.rate_hz(stream.name)
    if stream.name == "/markers" and rate == 0:
        message = Message(CheckCode.NO_CAPTURE, {"nominal_hz": stream.rate_hz})
        return CheckResult(stream.name, message, is_good=True, is_doubtful=True)
    figures: Figures = {"rate_hz": rate, "nominal_hz": stream.rate_hz, "source": stream.source}
    is_good = abs(rate - stream.rate_hz) <= RATE_TOLERANCE * stream.rate_hz
    return CheckResult(
        stream.name, Message(CheckCode.RATE if is_good else CheckCode.WRONG_RATE, figures), is_good=is_good
    )


def _check_force(survey: DeviceSurvey, config: StationConfig) -> list[CheckResult]:
    """The force with an empty hook is the zero, a free parameter of every fit; a saturated cell cannot be fitted."""
    raw, cell = survey.force(), config.calibration()
    if not len(raw):
        return []
    limit = full_scale(cell, config.daq.force_range_v if cell.source == "daq" else float("inf"))
    newtons = cell.polarity * cell.newtons_per_unit * raw
    figures: dict[str, float | str] = {"mean_n": float(newtons.mean()), "sd_n": float(newtons.std())}
    is_good = float(np.abs(raw).max()) < SATURATION * limit
    most = REST_PART_OF_CAPACITY * config.load_cell.capacity_n
    is_loaded = is_good and abs(float(newtons.mean())) > most
    code = CheckCode.LOADED if is_loaded else CheckCode.AT_REST
    if is_loaded:
        figures["limit_n"] = most
    elif not is_good:
        code, figures = CheckCode.SATURATED, {**figures, "limit": limit, "unit": survey.streams["/force"].unit}
    return [CheckResult("force at rest", Message(code, figures), is_good=is_good, is_doubtful=is_loaded)]


def _check_sync(survey: DeviceSurvey, config: StationConfig) -> list[CheckResult]:
    level, threshold = survey.last_value("/sync"), config.sync.threshold_v
    if level is None:
        return []
    code = CheckCode.SYNC_LOW if level < threshold else CheckCode.SYNC_HIGH
    message = Message(code, {"level_v": level, "threshold_v": threshold})
    return [CheckResult("sync line", message, is_good=level < threshold)]


def _check_labels(survey: DeviceSurvey, config: StationConfig) -> list[CheckResult]:
    if "/markers" not in survey.streams:
        return []
    present = set(survey.streams["/markers"].labels)
    expected = {
        f"markers of cuff {name}": {*cuff.anchor_markers, *cuff.cuff_markers, *cuff.rope_markers}
        for name, cuff in config.cuffs.items()
    }
    if config.body is not None:
        expected |= {"markers of the body": {*config.body.markers}, "markers of the suit": {*config.body.suit_markers}}
    results = []
    for subject, labels in expected.items():
        missing = sorted(labels - present)
        message = Message(CheckCode.LABELS_PRESENT)
        if missing:
            figures: Figures = {"missing": ", ".join(missing), "present": ", ".join(sorted(present))}
            message = Message(CheckCode.LABELS_MISSING, figures)
        results.append(CheckResult(subject, message, is_good=not missing))
    return results


def _check_disk(folder: Path, needed: float) -> CheckResult:
    free = bytes_free(folder)
    shown = folder.resolve() if folder == Path() else folder
    figures: Figures = {"free_gb": free / 1e9, "folder": str(shown), "needed_gb": needed / 1e9}
    code = CheckCode.DISK if free >= needed else CheckCode.DISK_LOW
    return CheckResult("disk", Message(code, figures), is_good=free >= needed)


def check_known_mass(
    config: StationConfig,
    folder: Path,
    mass: float,
    console: Console | None = None,
    make_devices: MakeDevices = load_cell_for,
    *,
    as_json: bool = False,
    listen_s: float = LISTEN_TO_MASS_S,
) -> int:
    """Read the cell, keep the reading in the folder, print it; return 0 if it is within the tolerance, else 1."""
    zeros = [check for check in read_checks(folder) if check.mass == 0]
    zero = zeros[-1] if zeros else None
    check, result = read_known_mass(config, folder, mass, zero, make_devices=make_devices, listen_s=listen_s)
    write_reading(folder, check)
    return show_results([result], console, as_json=as_json)


def inspect_bench_and_zero(
    config: StationConfig, folder: Path, timeout_scale: float
) -> tuple[list[CheckResult], MassCheck | None]:
    """The check of the bench, and the reading of the cell; None without samples of its force."""
    survey, devices = survey_devices(config, folder, RealClock(timeout_scale), devices_for)
    with suppress(MassCheckError):
        return compare(survey, devices, config, folder), _reading(survey, config, 0.0, None)
    return compare(survey, devices, config, folder), None


def read_known_mass(
    config: StationConfig,
    folder: Path,
    mass: float,
    zero: MassCheck | None,
    timeout_scale: float = 1.0,
    make_devices: MakeDevices = load_cell_for,
    listen_s: float = LISTEN_TO_MASS_S,
) -> tuple[MassCheck, CheckResult]:
    """Read the mass [kg] on the cell; zero is the last reading of the empty cell. Raises MassCheckError."""
    survey, _ = survey_devices(config, folder, RealClock(timeout_scale), make_devices, listen_s)
    zero, cell = zero if mass > 0 else None, config.calibration()
    check = _reading(survey, config, mass, zero)
    is_right = check.is_right(cell.gain_relative_sd, config.load_cell.capacity_kg)
    tolerance = check.tolerance(cell.gain_relative_sd, config.load_cell.capacity_kg)
    code = CheckCode.MASS_RIGHT if is_right else CheckCode.MASS_WRONG
    code = CheckCode.MASS_WITHOUT_ZERO if mass and zero is None else code
    shown = {"found_n": check.found, "sd_n": check.sd, "expected_n": check.expected, "tolerance_n": tolerance}
    return check, CheckResult(f"{mass:g} kg on the load cell", Message(code, shown), is_good=is_right)


def write_reading(folder: Path, check: MassCheck) -> None:
    """Keep a reading in the session's folder, where the fit reads it. Raises JournalError."""
    figures = {"mass_kg": check.mass, "expected_n": check.expected, "found_n": check.found, "u_n": check.sd}
    append_line(folder / CHECKS_FILE, "known_mass", at=check.at, **figures, zero_n=check.zero)


def _reading(survey: DeviceSurvey, config: StationConfig, mass: float, zero: MassCheck | None) -> MassCheck:
    cell = config.calibration()
    try:
        check = evaluate_reading(cell.polarity * cell.newtons_per_unit * survey.force(), mass, zero)
    except MassCheckError as error:
        errors = "; ".join(map(str, survey.errors.values()))
        device_errors = {"device_errors": errors} if errors else {}
        raise MassCheckError(FitErrorCode.CHECK_SHORT, {**error.reason.figures, **device_errors}) from error
    return replace(check, at=utc_now())
