"""Why F − k x of a swing is not a damper's force: eight checks, each with its number.

D1  the dynamic record's place against the static zero      D5  damping over frequency
D2  dynamic against static stiffness                        D6  direction of the pull
D3  curvature of the held loads                             D7  unloaded force and place between records
D4  harmonics in what the law leaves over                   D8  noise in the swing against that of the resting cuff
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from fitting.curves import TrialCurves
from fitting.dynamic.weak_form import ComplexStiffness
from fitting.laws.levels import Level, held_level, start_level, swing_force
from fitting.markers.frames import pull_direction
from fitting.quality import UnusableTrial
from fitting.results.codes import FindingCode
from fitting.results.rendering import Figures, name_of, sentence_of
from fitting.static.plateaus import Plateau
from fitting.uncertainty import Estimate

SIGNIFICANT = 3.0
SHIFT_LIMIT, ZERO_LIMIT = 0.5e-3, 1.0
"""m and N between records that are worth a word, if significant."""
STIFFNESS_LIMIT = 0.03
CURVATURE_LIMIT = 0.5
HARMONIC_LIMIT = 4.0
ANGLE_LIMIT = 10.0
NOISE_LIMIT = 1.3
WELL_KNOWN = 5.0
"""Standard errors of the mean damping from which its way with frequency is asked."""


_CHECKS = {
    FindingCode.START: "D1",
    FindingCode.STIFFNESS_RATIO: "D2",
    FindingCode.CURVATURE: "D3",
    FindingCode.HARMONICS: "D4",
    FindingCode.DAMPING_POWER: "D5",
    FindingCode.ANGLE: "D6",
    FindingCode.UNLOADED_FORCE: "D7",
    FindingCode.UNLOADED_PLACE: "D7",
    FindingCode.FORCE_NOISE: "D8",
    FindingCode.MARKER_MEMORY: "D8",
}


@dataclass(frozen=True)
class Finding:
    """The number of a check with its standard error (None where it has none) in `unit`; more: other figures, in SI."""

    code: FindingCode
    value: float
    standard_error: float | None
    unit: str
    is_alarm: bool
    more: Figures = field(default_factory=dict)

    @property
    def check(self) -> str:
        """D1 to D8."""
        return _CHECKS[self.code]

    @property
    def name(self) -> str:
        return name_of(self.code)

    @property
    def sentence(self) -> str:
        error = {} if self.standard_error is None else {"standard_error": self.standard_error}
        return sentence_of(self.code, {"value": self.value, **error, **self.more})


def find_all(
    curves: Sequence[TrialCurves], stiffness: Estimate | None, bands: Sequence[ComplexStiffness]
) -> Iterator[Finding]:
    """D1 to D8 of the used trials of one donning in time order, with its k and its complex stiffness."""
    static = [each for each in curves if each.static and each.static.plateaus]
    dynamic = [each for each in curves if each.dynamic is not None]
    pairs = [(each, _before(each, static)) for each in dynamic if static]
    yield from _place(pairs, stiffness)
    yield from _stiffnesses(dynamic, stiffness)
    yield from _curvature(static)
    yield from _harmonics(dynamic)
    yield from _over_frequency(bands)
    yield from _angle(static, dynamic)
    yield from _unloaded(pairs)
    yield from _noise(dynamic)


def _before(dynamic: TrialCurves, static: Sequence[TrialCurves]) -> TrialCurves:
    """The static trial that went before, else the first after."""
    earlier = [each for each in static if each.trial.start_utc_ns <= dynamic.trial.start_utc_ns]
    return earlier[-1] if earlier else static[0]


def _start(dynamic: TrialCurves, static: Level, stiffness: Estimate | None) -> tuple[Level, bool] | None:
    """Where a dynamic record is without load, and whether that was seen; else led down from its swing along k."""
    seen = start_level(dynamic)
    if seen is not None:
        return seen, True
    if stiffness is None or dynamic.dynamic is None:
        return None
    lift = (swing_force(dynamic) - static.force) / stiffness.value
    place = float(np.mean(dynamic.dynamic.displacement)) - lift
    return Level(static.force, static.force_sd, place, abs(lift) * stiffness.standard_error / stiffness.value), False


def _place(pairs: Sequence[tuple[TrialCurves, TrialCurves]], stiffness: Estimate | None) -> Iterator[Finding]:
    """D1: how far the dynamic record starts from the start of the held loads before it."""
    shifts, errors = [], []
    for dynamic, static in pairs:
        zero, end = (held_level(_plateaus(static)[i]) for i in (0, -1))
        start = _start(dynamic, zero, stiffness)
        if start is None:
            continue
        lift = (start[0].force - zero.force) / stiffness.value if stiffness and not start[1] else 0.0
        shifts.append((start[0].displacement - zero.displacement - lift, end.displacement - zero.displacement))
        errors.append(math.hypot(start[0].displacement_sd, zero.displacement_sd))
    if not shifts:
        return
    shift, migrated = max(shifts, key=lambda pair: abs(pair[0]))
    error = max(errors)
    more = {}
    if abs(migrated) > SHIFT_LIMIT and abs(shift - migrated) < abs(shift) / 2:
        more["migrated_m"] = migrated
    if stiffness is not None and abs(shift) > SHIFT_LIMIT:
        more["force_n"] = -stiffness.value * shift
    is_alarm = abs(shift) > max(SHIFT_LIMIT, SIGNIFICANT * error)
    yield Finding(FindingCode.START, shift, error, "m", is_alarm, more)


def _stiffnesses(dynamic: Sequence[TrialCurves], static: Estimate | None) -> Iterator[Finding]:
    found = [each.dynamic.stiffness for each in dynamic if each.dynamic and not each.dynamic.uses_static_stiffness]
    if static is None or not found:
        return
    swinging = float(np.mean([each.value for each in found]))
    own = math.sqrt(sum(each.standard_error**2 for each in found)) / len(found)
    spread = float(np.std([each.value for each in found], ddof=1)) / math.sqrt(len(found)) if len(found) > 2 else 0.0
    ratio = swinging / static.value
    error = ratio * math.hypot(max(own, spread) / swinging, static.standard_error / static.value)
    is_alarm = abs(ratio - 1) > max(STIFFNESS_LIMIT, SIGNIFICANT * error)
    more = {"dynamic_n_per_m": swinging, "static_n_per_m": static.value}
    yield Finding(FindingCode.STIFFNESS_RATIO, ratio, error, "1", is_alarm, more)


def _curvature(static: Sequence[TrialCurves]) -> Iterator[Finding]:
    """D3: how far the parabola through the held loads lies from its chord, in the middle of the range."""
    found = []
    for each in static:
        x = np.array([plateau.displacement for plateau in _plateaus(each)])
        force = np.array([plateau.force for plateau in _plateaus(each)])
        if len(x) < 4 or np.ptp(x) == 0:
            continue
        u = 2 * (x - x.min()) / np.ptp(x) - 1
        design = np.vander(u, 3)
        if np.linalg.matrix_rank(design) < 3:
            continue
        solved, _, _, _ = np.linalg.lstsq(design, force, rcond=None)
        variance = float(np.sum((force - design @ solved) ** 2)) / (len(x) - 3)
        found.append((solved[0], variance * np.linalg.inv(design.T @ design)[0, 0]))
    if not found:
        return
    bend, error = float(np.mean([b for b, _ in found])), math.sqrt(sum(v for _, v in found)) / len(found)
    is_alarm = abs(bend) > max(CURVATURE_LIMIT, SIGNIFICANT * error)
    yield Finding(FindingCode.CURVATURE, bend, error, "N", is_alarm)


def _harmonics(dynamic: Sequence[TrialCurves]) -> Iterator[Finding]:
    checks = [each.dynamic.checks for each in dynamic if each.dynamic]
    if not checks:
        return
    noise = math.sqrt(float(np.mean([each.harmonic_noise**2 for each in checks])))
    second, third = np.sqrt(np.mean(np.square([each.harmonics for each in checks]), axis=0)).tolist()
    largest = max(second, third)
    more = {"second_n": second, "third_n": third}
    yield Finding(FindingCode.HARMONICS, largest, noise, "N", largest > HARMONIC_LIMIT * noise, more)


def _over_frequency(bands: Sequence[ComplexStiffness]) -> Iterator[Finding]:
    """D5: the power of the frequency by which c grows: 0 for a damper, −1 for friction. A lag is in all bands alike."""
    if len(bands) < 2 or bands[-1].frequency < 1.3 * bands[0].frequency:
        return
    f, c, sd = np.array([(each.frequency, each.damping.value, each.damping.parts["noise"]) for each in bands]).T
    centred = np.log(f) - np.average(np.log(f), weights=sd**-2.0)
    mean, mean_sd = float(np.average(c, weights=sd**-2.0)), float(np.sum(sd**-2.0)) ** -0.5
    if mean < WELL_KNOWN * mean_sd:
        return
    information = float(sd**-2.0 @ centred**2)
    # Of c itself, not of its logarithm: that would leave out the bands in which noise made c small.
    power = float(sd**-2.0 @ (centred * c)) / information / mean
    scatter = float(np.sum(((c - mean - power * mean * centred) / sd) ** 2)) / max(1, len(c) - 2)
    error = math.sqrt(max(1.0, scatter)) * math.hypot(information**-0.5, power * mean_sd) / mean
    is_alarm = abs(power) > max(0.3, SIGNIFICANT * error)
    more = {"lowest_hz": bands[0].frequency, "highest_hz": bands[-1].frequency}
    yield Finding(FindingCode.DAMPING_POWER, power, error, "1", is_alarm, more)


def _angle(static: Sequence[TrialCurves], dynamic: Sequence[TrialCurves]) -> Iterator[Finding]:
    held, swung = _direction(static), _direction(dynamic)
    if held is None or swung is None:
        return
    angle = math.degrees(math.acos(min(1.0, abs(float(held @ swung)))))
    yield Finding(FindingCode.ANGLE, angle, None, "deg", angle > ANGLE_LIMIT)


def _direction(trials: Sequence[TrialCurves]) -> NDArray[np.float64] | None:
    """Unit vector (3,) along which the cuff goes in these trials."""
    moved = [(each.trial, each.motion) for each in trials if each.motion is not None]
    try:
        return pull_direction([trial for trial, _ in moved], [motion for _, motion in moved]) if moved else None
    except UnusableTrial:
        return None


def _unloaded(pairs: Sequence[tuple[TrialCurves, TrialCurves]]) -> Iterator[Finding]:
    """D7: from the end of the held loads to the start of the swing's record, both without load."""
    steps = []
    for dynamic, static in pairs:
        start, end = start_level(dynamic), _unloaded_end(static)
        if start is not None and end is not None:
            steps.append((start, end))
    if not steps:
        return
    force = max((a.force - b.force for a, b in steps), key=abs)
    place = max((a.displacement - b.displacement for a, b in steps), key=abs)
    force_sd = max(math.hypot(a.force_sd, b.force_sd) for a, b in steps)
    place_sd = max(math.hypot(a.displacement_sd, b.displacement_sd) for a, b in steps)
    is_alarm = abs(force) > max(ZERO_LIMIT, SIGNIFICANT * force_sd)
    yield Finding(FindingCode.UNLOADED_FORCE, force, force_sd, "N", is_alarm)
    is_alarm = abs(place) > max(SHIFT_LIMIT, SIGNIFICANT * place_sd)
    yield Finding(FindingCode.UNLOADED_PLACE, place, place_sd, "m", is_alarm)


def _unloaded_end(static: TrialCurves) -> Level | None:
    plateaus = _plateaus(static)
    first, last, top = plateaus[0], plateaus[-1], max(plateau.force for plateau in plateaus)
    if last is not first and abs(last.force - first.force) <= max(0.1 * (top - first.force), 3.0):
        return held_level(last)
    return held_level(first)


def _noise(dynamic: Sequence[TrialCurves]) -> Iterator[Finding]:
    """D8: force noise as fitted to the swing over that of the resting cuff, and the markers' memory."""
    ratios = [ratio for ratio in (_noise_ratio(each) for each in dynamic) if ratio is not None]
    if ratios:
        ratio = max(ratios)
        yield Finding(FindingCode.FORCE_NOISE, ratio, None, "1", ratio > NOISE_LIMIT)
    memories = [each.dynamic.checks.marker_correlation for each in dynamic if each.dynamic]
    if memories:
        coloured = any(each.dynamic.checks.is_coloured for each in dynamic if each.dynamic)
        more = {"white_noise": 0.0} if coloured else {}
        yield Finding(FindingCode.MARKER_MEMORY, max(memories), None, "1", coloured, more)


def _noise_ratio(curves: TrialCurves) -> float | None:
    if curves.dynamic is None or start_level(curves) is None:
        return None
    quiet = curves.force_time <= curves.force_time[0] + 1.0
    together = max(1, round(float(np.median(np.diff(curves.dynamic.time)) / np.median(np.diff(curves.force_time)))))
    whole = curves.force[quiet][: np.count_nonzero(quiet) // together * together].reshape(-1, together).mean(axis=1)
    rest = float(np.std(np.diff(whole))) / math.sqrt(2)
    return curves.dynamic.force_noise / rest if rest > 0 else None


def _plateaus(curves: TrialCurves) -> Sequence[Plateau]:
    if curves.static is None:
        raise ValueError("a dynamic trial has no held loads")
    return curves.static.plateaus
