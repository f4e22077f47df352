"""Causes: faults of the rig, and properties of the cuff beyond a spring and a damper.

Eight checks decide whether F − k x of a swing is the force of a damper:

D1  start of the dynamic record from the static zero        D5  damping over frequency
D2  dynamic over static stiffness                           D6  direction of the pull
D3  curvature of the held loads                             D7  unloaded force and position between records
D4  harmonics in the residual                               D8  noise in the swing over that of the resting cuff

Offsets of force or displacement (a tare with the weight on, drift of the zero, another zero of x, migration) make
F − k x negative throughout; lag, relaxation and friction do not. Properties of the cuff come from the comparison of
laws; faults of the rig from D6, D7, the weights of the protocol and the anchor markers.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
import scipy
from numpy.typing import NDArray

from documents.message import Figures
from fitting.diagnosis.identification import MIN_LOADS, FittedPull
from fitting.dynamic.cross_checks import ComplexStiffness
from fitting.dynamic.damping import DampingFit
from fitting.errors import UnusableTrial
from fitting.laws.model_class import FRICTION, GAIN, SLIP, SOFTENING, STIFFENING, ModelComparison
from fitting.pull.cuff_motion import LOOSE, SKIN_CORRELATION, pull_direction
from fitting.pull.plateaus import MAX_FRICTION, MAX_SCALE_ERROR, Plateau, is_unloaded, load_scale
from fitting.pull.pull import Pull
from fitting.results.codes import CauseCode, FindingCode
from fitting.results.sentences import NAMES
from fitting.uncertainty import Estimate, Repeat, combine
from solver.cuff import KelvinVoigt

SwingTrial = tuple[Pull, DampingFit]
"""A dynamic trial and the fit of its swing."""
Pair = tuple[Pull, DampingFit, Sequence[Plateau]]
"""The same with the held loads before it."""
SIGNIFICANT = 3.0
SHIFT_LIMIT, ZERO_LIMIT = 0.5e-3, 1.0
"""m and N between records from which a significant change is reported."""
STIFFNESS_LIMIT = 0.03
CURVATURE_LIMIT = 0.5
HARMONIC_LIMIT = 4.0
ANGLE_LIMIT = 10.0
NOISE_LIMIT = 1.3
WELL_KNOWN = 5.0
"""Mean damping over its standard error from which its dependence on frequency is checked."""
_CHECKS = dict(zip(FindingCode, ("D1", "D2", "D3", "D4", "D5", "D6", "D7", "D7", "D8", "D8"), strict=True))


@dataclass(frozen=True)
class Finding:
    """The figure of a check and its standard error (or None) in `unit`; more: other figures, in SI."""

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
        return NAMES[self.code]

    @property
    def sentence(self) -> str:
        error = {} if self.standard_error is None else {"standard_error": self.standard_error}
        return self.code.sentence({"value": self.value, **error, **self.more})


def find_all(
    pulls: Sequence[FittedPull], stiffness: Estimate | None, bands: Sequence[ComplexStiffness]
) -> Iterator[Finding]:
    """D1 to D8 of the used trials of one donning in time order, with its k and its complex stiffness."""
    static, dynamic = _held(pulls), _swing_trials(pulls)
    swings = [swing for _, swing in dynamic]
    with_zero = [fitted for fitted in static if _has_zero(fitted.plateaus)]
    pairs = [(*fitted, _before(fitted[0], with_zero)) for fitted in dynamic if with_zero]
    yield from _start_shift(pairs, stiffness)
    yield from _stiffnesses(swings, stiffness)
    yield from _curvature(static)
    yield from _harmonics(swings)
    yield from _over_frequency(bands)
    yield from _angle([fitted.pull for fitted in static], [pull for pull, _ in dynamic])
    yield from _unloaded(pairs)
    yield from _noise(dynamic)


def _held(pulls: Sequence[FittedPull]) -> list[FittedPull]:
    return [fitted for fitted in pulls if fitted.plateaus]


def _swing_trials(pulls: Sequence[FittedPull]) -> list[SwingTrial]:
    return [(fitted.pull, fitted.dynamic) for fitted in pulls if fitted.dynamic]


def _has_zero(plateaus: Sequence[Plateau]) -> bool:
    """Whether the first held load is that of the bare hook, which a single load, without others, does not show."""
    return len(plateaus) >= MIN_LOADS and is_unloaded(plateaus[0], plateaus)


def _before(dynamic: Pull, static: Sequence[FittedPull]) -> Sequence[Plateau]:
    """Held loads of the last static trial before the dynamic one, or else of the first after it."""
    earlier = [fitted for fitted in static if fitted.pull.trial.start_utc_ns <= dynamic.trial.start_utc_ns]
    return (earlier or static[:1])[-1].plateaus


def _start(pull: Pull, swing: DampingFit, static: Level, stiffness: Estimate | None) -> Level | None:
    """Unloaded level of a dynamic record: observed, or else extrapolated from the swing along k."""
    seen = start_level(pull, swing)
    if seen is not None or stiffness is None:
        return seen
    lift = float(KelvinVoigt(stiffness.value).equilibrium(swing_force(pull, swing) - static.force))
    position = float(np.mean(swing.displacement)) - lift
    return Level(static.force, static.force_sd, position, abs(lift) * stiffness.standard_error / stiffness.value)


def _start_shift(pairs: Sequence[Pair], stiffness: Estimate | None) -> Iterator[Finding]:
    """D1: distance of the start of the dynamic record from the start of the held loads before it."""
    shifts, errors = [], []
    for pull, swing, plateaus in pairs:
        zero, end = held_level(plateaus[0]), held_level(plateaus[-1])
        start = _start(pull, swing, zero, stiffness)
        if start is None:
            continue
        shifts.append((start.displacement - zero.displacement, end.displacement - zero.displacement))
        errors.append(math.hypot(start.displacement_sd, zero.displacement_sd))
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


def _stiffnesses(swings: Sequence[DampingFit], static: Estimate | None) -> Iterator[Finding]:
    found = [swing.stiffness for swing in swings if not swing.uses_static_stiffness]
    if static is None or not found:
        return
    values = [stiffness.value for stiffness in found]
    swinging = float(np.mean(values))
    own = math.sqrt(sum(stiffness.standard_error**2 for stiffness in found)) / len(found)
    spread = float(np.std(values, ddof=1)) / math.sqrt(len(values)) if len(values) > 2 else 0.0
    ratio = swinging / static.value
    error = ratio * math.hypot(max(own, spread) / swinging, static.standard_error / static.value)
    is_alarm = abs(ratio - 1) > max(STIFFNESS_LIMIT, SIGNIFICANT * error)
    more = {"dynamic_n_per_m": swinging, "static_n_per_m": static.value}
    yield Finding(FindingCode.STIFFNESS_RATIO, ratio, error, "1", is_alarm, more)


def _curvature(static: Sequence[FittedPull]) -> Iterator[Finding]:
    """D3: distance of the parabola through the held loads from its chord, in the middle of the range."""
    found = []
    for fitted in static:
        x, force = np.array([(plateau.displacement, plateau.force) for plateau in fitted.plateaus]).T
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


def _harmonics(swings: Sequence[DampingFit]) -> Iterator[Finding]:
    checks = [swing.checks for swing in swings]
    if not checks:
        return
    noise = math.sqrt(float(np.mean([check.harmonic_noise**2 for check in checks])))
    second, third = np.sqrt(np.mean(np.square([check.harmonics for check in checks]), axis=0)).tolist()
    largest = max(second, third)
    more = {"second_n": second, "third_n": third}
    yield Finding(FindingCode.HARMONICS, largest, noise, "N", largest > HARMONIC_LIMIT * noise, more)


def _over_frequency(bands: Sequence[ComplexStiffness]) -> Iterator[Finding]:
    """D5: exponent of c over frequency: 0 for a damper, −1 for friction. A lag affects all bands equally."""
    if len(bands) < 2 or bands[-1].frequency < 1.3 * bands[0].frequency:
        return
    f, c, sd = np.array([(band.frequency, band.damping.value, band.damping.parts["noise"]) for band in bands]).T
    centred = np.log(f) - np.average(np.log(f), weights=sd**-2.0)
    mean, mean_sd = float(np.average(c, weights=sd**-2.0)), float(np.sum(sd**-2.0)) ** -0.5
    if mean < WELL_KNOWN * mean_sd:
        return
    information = float(sd**-2.0 @ centred**2)
    # A fit of log c would leave out the bands in which noise made c negative.
    power = float(sd**-2.0 @ (centred * c)) / information / mean
    scatter = float(np.sum(((c - mean - power * mean * centred) / sd) ** 2)) / max(1, len(c) - 2)
    error = math.sqrt(max(1.0, scatter)) * math.hypot(information**-0.5, power * mean_sd) / mean
    is_alarm = abs(power) > max(0.3, SIGNIFICANT * error)
    more = {"lowest_hz": bands[0].frequency, "highest_hz": bands[-1].frequency}
    yield Finding(FindingCode.DAMPING_POWER, power, error, "1", is_alarm, more)


def _angle(static: Sequence[Pull], dynamic: Sequence[Pull]) -> Iterator[Finding]:
    held, swung = _direction(static), _direction(dynamic)
    if held is None or swung is None:
        return
    angle = math.degrees(math.acos(min(1.0, abs(float(held @ swung)))))
    yield Finding(FindingCode.ANGLE, angle, None, "deg", angle > ANGLE_LIMIT)


def _direction(pulls: Sequence[Pull]) -> NDArray[np.float64] | None:
    """Unit vector (3,) of the displacement in these trials."""
    if not pulls:
        return None
    try:
        return pull_direction([pull.trial for pull in pulls], [pull.motion for pull in pulls])
    except UnusableTrial:
        return None


def _unloaded(pairs: Sequence[Pair]) -> Iterator[Finding]:
    """D7: change from the end of the held loads to the start of the dynamic record, both unloaded."""
    found = ((start_level(pull, swing), _unloaded_end(plateaus)) for pull, swing, plateaus in pairs)
    steps = [(start, end) for start, end in found if start is not None]
    if not steps:
        return
    force = max((a.force - b.force for a, b in steps), key=abs)
    position = max((a.displacement - b.displacement for a, b in steps), key=abs)
    force_sd = max(math.hypot(a.force_sd, b.force_sd) for a, b in steps)
    position_sd = max(math.hypot(a.displacement_sd, b.displacement_sd) for a, b in steps)
    is_alarm = abs(force) > max(ZERO_LIMIT, SIGNIFICANT * force_sd)
    yield Finding(FindingCode.UNLOADED_FORCE, force, force_sd, "N", is_alarm)
    is_alarm = abs(position) > max(SHIFT_LIMIT, SIGNIFICANT * position_sd)
    yield Finding(FindingCode.UNLOADED_POSITION, position, position_sd, "m", is_alarm)


def _unloaded_end(plateaus: Sequence[Plateau]) -> Level:
    first, last, top = plateaus[0], plateaus[-1], max(plateau.force for plateau in plateaus)
    is_unloaded_last = abs(last.force - first.force) <= max(0.1 * (top - first.force), 3.0)
    return held_level(last if is_unloaded_last else first)


def _noise(dynamic: Sequence[SwingTrial]) -> Iterator[Finding]:
    """D8: fitted force noise of the swing over that of the resting cuff, and correlation of the marker noise."""
    noises = [noise for pull, swing in dynamic if (noise := _noises(pull, swing)) is not None]
    if noises:
        swing, rest, swing_dof, rest_dof = np.array(noises).T
        ratio = math.sqrt(float((swing_dof @ swing**2 / swing_dof.sum()) / (rest_dof @ rest**2 / rest_dof.sum())))
        error = math.sqrt(1 / (2 * float(swing_dof.sum())) + 1 / (2 * float(rest_dof.sum())))  # of its logarithm
        # The variance of few samples at rest is skewed: the F distribution, at the probability of 3 standard errors.
        significant = math.sqrt(scipy.special.fdtri(swing_dof.sum(), rest_dof.sum(), scipy.special.ndtr(SIGNIFICANT)))
        is_alarm = ratio > max(NOISE_LIMIT, significant)
        yield Finding(FindingCode.FORCE_NOISE, ratio, ratio * error, "1", is_alarm)
    if checks := [swing.checks for _, swing in dynamic]:
        is_coloured = any(check.is_coloured for check in checks)
        more = {"white_noise": 0.0} if is_coloured else {}
        largest = max(check.marker_correlation for check in checks)
        yield Finding(FindingCode.MARKER_CORRELATION, largest, None, "1", is_coloured, more)


def _noises(pull: Pull, swing: DampingFit) -> tuple[float, float, float, float] | None:
    """Standard deviation of the force noise in the swing and at rest [N], each with its degrees of freedom."""
    if start_level(pull, swing) is None:
        return None
    quiet = pull.force_time <= pull.force_time[0] + 1.0
    together = max(1, round(float(np.median(np.diff(swing.time)) / np.median(np.diff(pull.force_time)))))
    whole = pull.force[quiet][: np.count_nonzero(quiet) // together * together].reshape(-1, together).mean(axis=1)
    if len(whole) < 3 or np.ptp(whole) == 0:
        return None
    rest = float(np.std(np.diff(whole))) / math.sqrt(2)
    # The variance from differences of n white samples has the relative variance 3/n (von Neumann 1941).
    return swing.force_noise, rest, float(len(swing.time)), len(whole) / 1.5


LEAD_IN = 1.0
STEADY = 1.0
"""N within which the quarters of the lead-in must agree, beside their noise."""
SWAY = 0.02e-3
"""m, standard error of a position beside its noise: residual of the sway correction for a slowly moving body."""


@dataclass(frozen=True)
class Level:
    """Mean force [N] and displacement [m] of an unloaded stretch, with standard errors."""

    force: float
    force_sd: float
    displacement: float
    displacement_sd: float


def start_level(pull: Pull, swing: DampingFit) -> Level | None:
    """The first second of a dynamic record if it is steady and below the swing, otherwise None."""
    in_force = pull.force_time <= pull.force_time[0] + LEAD_IN
    in_frames = (pull.marker_time <= pull.force_time[0] + LEAD_IN) & np.isfinite(pull.displacement)
    if np.count_nonzero(in_force) < 8 or np.count_nonzero(in_frames) < 20:
        return None
    force, displacement = pull.force[in_force], pull.displacement[in_frames]
    quarters = [float(part.mean()) for part in np.array_split(force, 4)]
    noise = float(np.std(force)) / math.sqrt(len(force) / 4)
    below = swing_force(pull, swing) - 0.8 * swing.oscillation.amplitude
    if max(quarters) - min(quarters) > STEADY + 4 * noise or np.mean(force) > below:
        return None
    return Level(*_mean(force), *_mean(displacement, SWAY))


def held_level(plateau: Plateau) -> Level:
    """A held load as a level."""
    displacement_sd = math.hypot(plateau.displacement_sd, SWAY, plateau.unsettled)
    return Level(plateau.force, plateau.force_sd, plateau.displacement, displacement_sd)


def swing_force(pull: Pull, swing: DampingFit) -> float:
    """Mean force [N] of the swing."""
    inside = (pull.force_time >= swing.oscillation.start) & (pull.force_time <= swing.oscillation.end)
    return float(np.mean(pull.force[inside]))


def _mean(values: NDArray[np.float64], floor: float = 0.0) -> tuple[float, float]:
    return float(np.mean(values)), math.hypot(float(np.std(values)) / math.sqrt(len(values)), floor)


TARED_BELOW = 0.5
"""Share of the swing's amplitude: a smaller mean force was removed by a tare."""
ALIKE = 0.15
"""A law is an explanation, too, unless the mean square of the chosen one is lower by more than this part."""
LEAVES_DISPLACEMENT = {SLIP, FRICTION, "creep"}
"""Laws with which an unloaded cuff is not where it was before the load."""
LAWS = (STIFFENING, SOFTENING, SLIP, FRICTION, "standard linear solid", "creep")
"""Extensions of the law (model_class.py); the cause has the same name."""


@dataclass(frozen=True)
class Cause:
    """A possible cause, and the check that indicates it; severity is its figure over the limit from which it counts."""

    code: CauseCode
    severity: float
    figures: Figures = field(default_factory=dict)
    finding: Finding | None = None

    @property
    def name(self) -> str:
        return NAMES[self.code]

    @property
    def sentence(self) -> str:
        found = {self.finding.code.value: self.finding.sentence} if self.finding else {}
        return self.code.sentence({"name": self.name, **found, **self.figures})


@dataclass(frozen=True)
class Diagnosis:
    """findings in the order D1 to D8; causes, most severe first, empty without a problem.

    classes is the comparison of laws; stiffening is renamed softening if the held loads curve downward.
    """

    findings: tuple[Finding, ...]
    causes: tuple[Cause, ...]
    classes: ModelComparison | None


def diagnose(
    pulls: Sequence[FittedPull],
    stiffness: Estimate | None,
    bands: Sequence[ComplexStiffness],
    classes: ModelComparison | None,
    *,
    creeps: bool = True,
) -> Diagnosis:
    """Checks and causes from the used trials of one donning in time order, its k, complex stiffness and laws.

    creeps is False if the displacement does not increase under held loads.
    """
    findings = tuple(_without_misfit(find_all(pulls, stiffness, bands), classes))
    bends_down = any(finding.code is FindingCode.CURVATURE and finding.value < 0 for finding in findings)
    if classes is not None and bends_down:
        classes = classes.as_softening()
    return Diagnosis(findings, find_causes(findings, pulls, classes, creeps=creeps), classes)


def _without_misfit(findings: Iterable[Finding], classes: ModelComparison | None) -> Iterator[Finding]:
    """No alarm on correlated marker noise where another law explains the residual of a spring and a damper."""
    for finding in findings:
        is_misfit = finding.code is FindingCode.MARKER_CORRELATION and classes is not None and bool(classes.chosen)
        yield replace(finding, is_alarm=finding.is_alarm and not is_misfit)


def find_causes(
    findings: Sequence[Finding], pulls: Sequence[FittedPull], classes: ModelComparison | None, *, creeps: bool = True
) -> tuple[Cause, ...]:
    """Causes indicated by the findings on these trials and by the comparison of laws, most severe first.

    creeps is False if held loads were examined and the displacement does not increase under them.
    """
    static = _held(pulls)
    found = [
        *_rig_causes(findings, static, _swing_trials(pulls), classes),
        *_anchor_causes(pulls),
        *_weight_causes(static),
        *_law_causes(classes, creeps=creeps),
    ]
    if any(cause.code is CauseCode.PULL_DIRECTION for cause in found):  # which has a stiffness of its own
        found = [cause for cause in found if cause.code is not CauseCode.STANDARD_LINEAR_SOLID]
    return tuple(sorted(found, key=lambda cause: -cause.severity))


def _rig_causes(
    findings: Sequence[Finding],
    static: Sequence[FittedPull],
    dynamic: Sequence[SwingTrial],
    classes: ModelComparison | None,
) -> Iterator[Cause]:
    by_code = {finding.code: finding for finding in findings}
    bare = [fitted.plateaus[0].force for fitted in static]
    tared = any(_is_tared(*swung, bare) for swung in dynamic)
    angle = by_code.get(FindingCode.ANGLE)
    if angle and angle.is_alarm:
        yield Cause(CauseCode.PULL_DIRECTION, 10 * angle.value / ANGLE_LIMIT, finding=angle)
    force, position = by_code.get(FindingCode.UNLOADED_FORCE), by_code.get(FindingCode.UNLOADED_POSITION)
    start = by_code.get(FindingCode.START)
    has_other_zero = not _is_displaced_by_law(start, static, classes)
    if force is None or position is None:
        if has_other_zero:
            yield from _offset_causes(start, tared=tared)
        return
    if force.is_alarm:
        yield Cause(CauseCode.TARE if tared else CauseCode.ZERO_DRIFT, abs(force.value) / ZERO_LIMIT, finding=force)
    if position.is_alarm and has_other_zero:
        yield Cause(CauseCode.DISPLACEMENT_ZERO, abs(position.value) / SHIFT_LIMIT, finding=position)


def _offset_causes(position: Finding | None, *, tared: bool) -> Iterator[Cause]:
    """Causes if no unloaded stretch was recorded: the offset may be one of force or of displacement."""
    if position is None or not position.is_alarm:
        return
    severity = abs(position.value) / SHIFT_LIMIT
    codes = [CauseCode.TARE] * tared + [CauseCode.DISPLACEMENT_ZERO, CauseCode.ZERO_DRIFT]
    for rank, code in enumerate(codes):
        yield Cause(code, severity * 0.9**rank, finding=position)


def _is_displaced_by_law(start: Finding | None, static: Sequence[FittedPull], classes: ModelComparison | None) -> bool:
    """Whether the swing starts where a law with a memory leaves the cuff: between first and last unloaded position."""
    if start is None or classes is None or not LEAVES_DISPLACEMENT.intersection(classes.chosen):
        return False
    ends = [0.0, *(trial.plateaus[-1].displacement - trial.plateaus[0].displacement for trial in static)]
    return min(ends) - SHIFT_LIMIT < start.value < max(ends) + SHIFT_LIMIT


def _is_tared(pull: Pull, swing: DampingFit, bare: Sequence[float]) -> bool:
    """Whether the mean force of the swing is near zero or near the force of the bare hook [N]: tared with weight."""
    force, near = swing_force(pull, swing), TARED_BELOW * swing.oscillation.amplitude
    return force < near or any(abs(force - zero) < near for zero in bare)


def _anchor_causes(pulls: Sequence[FittedPull]) -> Iterator[Cause]:
    """Skin that moves with the load, or else a marker that moves on its body."""
    follows = [fitted.pull.markers.anchor_follows_force for fitted in pulls]
    if follows and (correlation := float(np.mean(follows))) > SKIN_CORRELATION:
        yield Cause(CauseCode.SKIN, 10 * correlation / SKIN_CORRELATION, {"correlation": correlation})
        return
    loose = [fitted.pull.markers.loose for fitted in pulls if fitted.pull.markers.loose]
    if loose:
        label, rms = max(loose, key=lambda marker: marker[1])
        yield Cause(CauseCode.LOOSE_MARKER, rms / LOOSE, {"marker": label, "rms_m": rms})


def _weight_causes(static: Sequence[FittedPull]) -> Iterator[Cause]:
    """Errors of the load cell's scale and friction of the pulley, from the weights of the protocol.

    If the load cell reads a known mass correctly, the loads are wrong instead of its scale.
    """
    scales = (load_scale(fitted.plateaus, fitted.pull.trial.step_masses) for fitted in static)
    found = [scale for scale in scales if scale is not None]
    if not found:
        return
    gain = combine([Repeat(scale.gain.value, scale.gain.standard_error) for scale in found])
    if abs(gain.value - 1) > max(MAX_SCALE_ERROR, SIGNIFICANT * gain.standard_error):
        figures = {"gain": gain.value, "standard_error": gain.standard_error, "error": gain.value - 1}
        is_cell_right = all(fitted.pull.trial.is_gain_checked for fitted in static)
        code = CauseCode.LOADS if is_cell_right else CauseCode.GAIN
        yield Cause(code, 10 * abs(gain.value - 1) / MAX_SCALE_ERROR, figures)
    frictions = [scale.friction for scale in found if scale.has_friction and scale.friction is not None]
    if frictions:
        mu = max(frictions, key=lambda friction: abs(friction.value))
        figures = {"friction": mu.value, "standard_error": mu.standard_error}
        yield Cause(CauseCode.PULLEY, abs(mu.value) / MAX_FRICTION, figures)


def _law_causes(classes: ModelComparison | None, *, creeps: bool) -> Iterator[Cause]:
    """The chosen extensions, and those that explain nearly as much (ALIKE), and enough to be an extension (GAIN).

    Creep also explains part of friction. If no hold shows creep, friction is ranked before it; if holds do, friction
    and slip are no explanation, because they do not move a cuff under a constant load.
    """
    if classes is None or not classes.chosen:
        return
    gains = {score.name: score.gain for score in classes.ranking}
    best = max(gains[name] for name in (classes.name, *classes.chosen) if name in gains)
    for name in dict.fromkeys((*classes.chosen, *gains)):
        if name not in classes.chosen:
            is_excluded = classes.chosen == ("creep",) and creeps and name in {FRICTION, SLIP}
            is_worse = (1 - best) < (1 - ALIKE) * (1 - gains[name])
            if name not in LAWS or is_excluded or is_worse or gains[name] < GAIN:
                continue
        is_friction = name == "creep" and not creeps and FRICTION in classes.chosen
        share = 1.0 if name in classes.chosen and not is_friction else 0.5
        gain = max(gains[name], GAIN)
        severity = share * gain / (1 - min(gain, 0.99)) / (GAIN / (1 - GAIN))
        yield Cause(CauseCode(f"cause.{name.replace(' ', '_')}"), severity, {"law": name, "gain": gain})
