"""Causes: faults of the rig, and properties of the cuff beyond a spring and a damper.

Offsets of force or displacement (a tare with the weight on, drift of the zero, another zero of x, migration) make
F − k x negative throughout; lag, relaxation and friction do not. Properties of the cuff come from the comparison of
laws; faults of the rig from D6, D7, the weights of the protocol and the anchor markers.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from fitting.diagnosis.findings import ANGLE_LIMIT, SHIFT_LIMIT, SIGNIFICANT, ZERO_LIMIT, Finding, find_all, swing_force
from fitting.diagnosis.fitted_pull import FittedPull
from fitting.dynamic.weak_form import ComplexStiffness
from fitting.laws.model_class import FRICTION, GAIN, SLIP, SOFTENING, STIFFENING, ModelComparison
from fitting.pull.hung_weights import MAX_FRICTION, MAX_SCALE_ERROR, load_scale
from fitting.pull.rigid import LOOSE, SKIN_CORRELATION
from fitting.results.codes import CauseCode, FindingCode
from fitting.results.rendering import Figures, name_of, sentence_of
from fitting.uncertainty import Estimate, Repeat, combine

TARED_BELOW = 0.5
"""Share of the swing's amplitude: a smaller mean force was removed by a tare."""
ALIKE = 0.15
"""A law is an explanation, too, unless the mean square of the chosen one is lower by more than this part."""
LEAVES_DISPLACEMENT = {SLIP, FRICTION, "creep"}
"""Laws with which an unloaded cuff is not where it was before the load."""
LAW_CAUSES = {
    STIFFENING: CauseCode.STIFFENING,
    SOFTENING: CauseCode.SOFTENING,
    SLIP: CauseCode.SLIP,
    FRICTION: CauseCode.FRICTION,
    "standard linear solid": CauseCode.STANDARD_LINEAR_SOLID,
    "creep": CauseCode.CREEP,
}
"""Extension of the law (model_class.py) → cause."""


@dataclass(frozen=True)
class Cause:
    """A possible cause; severity is its figure over the limit from which it is reported.

    finding  the check that indicates it, if any
    """

    code: CauseCode
    severity: float
    figures: Figures = field(default_factory=dict)
    finding: Finding | None = None

    @property
    def name(self) -> str:
        return name_of(self.code)

    @property
    def sentence(self) -> str:
        found = {self.finding.code.value: self.finding.sentence} if self.finding else {}
        return sentence_of(self.code, {"name": self.name, **found, **self.figures})


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
    return Diagnosis(findings, causes_of(findings, pulls, classes, creeps=creeps), classes)


def _without_misfit(findings: Iterable[Finding], classes: ModelComparison | None) -> Iterator[Finding]:
    """No alarm on correlated marker noise where another law explains the residual of a spring and a damper."""
    for finding in findings:
        is_misfit = finding.code is FindingCode.MARKER_CORRELATION and classes is not None and bool(classes.chosen)
        yield replace(finding, is_alarm=finding.is_alarm and not is_misfit)


def causes_of(
    findings: Sequence[Finding],
    pulls: Sequence[FittedPull],
    classes: ModelComparison | None,
    *,
    creeps: bool = True,
) -> tuple[Cause, ...]:
    """Causes indicated by the findings on these trials and by the comparison of laws, most severe first.

    creeps is False if held loads were examined and the displacement does not increase under them.
    """
    static = [fitted for fitted in pulls if fitted.static and fitted.static.plateaus]
    dynamic = [fitted for fitted in pulls if fitted.dynamic is not None]
    found = [
        *_rig_causes(findings, static, dynamic, classes),
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
    dynamic: Sequence[FittedPull],
    classes: ModelComparison | None,
) -> Iterator[Cause]:
    by_code = {finding.code: finding for finding in findings}
    bare = [fitted.static.plateaus[0].force for fitted in static if fitted.static]
    tared = any(_is_tared(fitted, bare) for fitted in dynamic)
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
    codes = [CauseCode.DISPLACEMENT_ZERO, CauseCode.ZERO_DRIFT]
    if tared:
        codes.insert(0, CauseCode.TARE)
    for rank, code in enumerate(codes):
        yield Cause(code, severity * 0.9**rank, finding=position)


def _is_displaced_by_law(start: Finding | None, static: Sequence[FittedPull], classes: ModelComparison | None) -> bool:
    """Whether the swing starts where a law with a memory leaves the cuff: between first and last unloaded position."""
    if start is None or classes is None or not LEAVES_DISPLACEMENT.intersection(classes.chosen):
        return False
    ends = [0.0]
    for fitted in static:
        plateaus = fitted.static.plateaus if fitted.static else ()
        ends += [plateau.displacement - plateaus[0].displacement for plateau in plateaus[-1:]]
    return min(ends) - SHIFT_LIMIT < start.value < max(ends) + SHIFT_LIMIT


def _is_tared(fitted: FittedPull, bare: Sequence[float]) -> bool:
    """Whether the mean force of the swing is near zero or near the force of the bare hook [N]: tared with weight."""
    if fitted.dynamic is None:
        return False
    force, near = swing_force(fitted), TARED_BELOW * fitted.dynamic.oscillation.amplitude
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
    scales = [load_scale(fitted.static.plateaus, fitted.pull.trial.step_masses) for fitted in static if fitted.static]
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
            if name not in LAW_CAUSES or is_excluded or is_worse or gains[name] < GAIN:
                continue
        is_friction = name == "creep" and not creeps and FRICTION in classes.chosen
        share = 1.0 if name in classes.chosen and not is_friction else 0.5
        gain = max(gains[name], GAIN)
        severity = share * gain / (1 - min(gain, 0.99)) / (GAIN / (1 - GAIN))
        yield Cause(LAW_CAUSES[name], severity, {"law": name, "gain": gain})
