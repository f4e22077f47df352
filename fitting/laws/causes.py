"""What may be wrong with a rig, or richer in a cuff, with what it means for the figures and what to do next.

Offsets of force or place (a tare with the weight on, drift of the zero, another zero of x, migration) are the causes
that make F − k x negative throughout; lag, relaxation and friction do not. Laws richer than a spring and a damper are
named by the comparison of classes, causes in the rig by D6, D7, the protocol's weights and the anchor markers.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field

import numpy as np

from fitting.curves import TrialCurves
from fitting.laws.findings import ANGLE_LIMIT, SHIFT_LIMIT, SIGNIFICANT, ZERO_LIMIT, Finding
from fitting.laws.levels import swing_force
from fitting.laws.model_class import GAIN, SLIP, SOFTENING, STIFFENING, ModelComparison
from fitting.markers.loose import LOOSE
from fitting.quality import SKIN_CORRELATION
from fitting.results.codes import CauseCode, FindingCode
from fitting.results.rendering import Figures, name_of, sentence_of
from fitting.static.steps import MAX_FRICTION, MAX_SCALE_ERROR, load_scale
from fitting.uncertainty import Repeat, combine

TARED_BELOW = 0.5
"""Of the swing's amplitude: a mean force nearer to zero than that was tared away."""
LAW_CAUSES = {
    STIFFENING: CauseCode.STIFFENING,
    SOFTENING: CauseCode.SOFTENING,
    SLIP: CauseCode.SLIP,
    "friction": CauseCode.FRICTION,
    "standard linear solid": CauseCode.STANDARD_LINEAR_SOLID,
    "creep": CauseCode.CREEP,
}
"""Extension of the law (model_class.py) → the cause that it is."""


@dataclass(frozen=True)
class Cause:
    """What may be wrong; severity is how many times the figure behind it exceeds what is worth a word.

    finding  the check that points at it, where it is one
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


def causes_of(
    findings: Sequence[Finding],
    curves: Sequence[TrialCurves],
    classes: ModelComparison | None,
    *,
    creeps: bool = True,
) -> tuple[Cause, ...]:
    """The causes that the findings on these trials and the comparison of classes point at, most severe first.

    creeps is False where held loads were looked at, and do not go on yielding.
    """
    static = [each for each in curves if each.static and each.static.plateaus]
    dynamic = [each for each in curves if each.dynamic is not None]
    found = [
        *_rig_causes(findings, static, dynamic),
        *_anchor(curves),
        *_weights(static),
        *_law_causes(classes, creeps),
    ]
    return tuple(sorted(found, key=lambda cause: -cause.severity))


def _rig_causes(
    findings: Sequence[Finding], static: Sequence[TrialCurves], dynamic: Sequence[TrialCurves]
) -> Iterator[Cause]:
    by_code = {finding.code: finding for finding in findings}
    bare = [each.static.plateaus[0].force for each in static if each.static]
    tared = any(_is_tared(each, bare) for each in dynamic)
    angle = by_code.get(FindingCode.ANGLE)
    if angle and angle.is_alarm:
        yield Cause(CauseCode.PULL_DIRECTION, 10 * angle.value / ANGLE_LIMIT, finding=angle)
    force, place = by_code.get(FindingCode.UNLOADED_FORCE), by_code.get(FindingCode.UNLOADED_PLACE)
    if force is None or place is None:
        yield from _unseen(by_code.get(FindingCode.START), tared)
        return
    if force.is_alarm:
        severity = abs(force.value) / ZERO_LIMIT
        codes = (CauseCode.TARE, CauseCode.ZERO_DRIFT)
        for code, share in zip(codes if tared else codes[::-1], (1.0, 0.1), strict=True):
            yield Cause(code, share * severity, finding=force)
    if place.is_alarm:
        yield Cause(CauseCode.DISPLACEMENT_ZERO, abs(place.value) / SHIFT_LIMIT, finding=place)


def _unseen(place: Finding | None, tared: bool) -> Iterator[Cause]:
    """Without an unloaded stretch an offset may be one of force or of place."""
    if place is None or not place.is_alarm:
        return
    severity = abs(place.value) / SHIFT_LIMIT
    codes = [CauseCode.DISPLACEMENT_ZERO, CauseCode.ZERO_DRIFT]
    if tared:
        codes.insert(0, CauseCode.TARE)
    for rank, code in enumerate(codes):
        yield Cause(code, severity * 0.9**rank, finding=place)


def _is_tared(curves: TrialCurves, bare: Sequence[float]) -> bool:
    """Whether the swing's mean force is near zero, or near what the bare hook read [N], as after a tare with weight."""
    if curves.dynamic is None:
        return False
    force, near = swing_force(curves), TARED_BELOW * curves.dynamic.oscillation.amplitude
    return force < near or any(abs(force - zero) < near for zero in bare)


def _anchor(curves: Sequence[TrialCurves]) -> Iterator[Cause]:
    loose = [each.markers.loose for each in curves if each.markers is not None and each.markers.loose]
    if loose:
        label, way = max(loose, key=lambda each: each[1])
        yield Cause(CauseCode.LOOSE_MARKER, way / LOOSE, {"marker": label, "rms_m": way})
    follows = [each.markers.anchor_follows_force for each in curves if each.markers is not None]
    if follows and (correlation := float(np.mean(follows))) > SKIN_CORRELATION:
        yield Cause(CauseCode.SKIN, 10 * correlation / SKIN_CORRELATION, {"correlation": correlation})


def _weights(static: Sequence[TrialCurves]) -> Iterator[Cause]:
    """What the protocol's weights say of the load cell's scale and of the pulley."""
    scales = [load_scale(each.static.plateaus, each.trial.step_masses) for each in static if each.static]
    found = [scale for scale in scales if scale is not None]
    if not found:
        return
    gain = combine([Repeat(scale.gain.value, scale.gain.standard_error) for scale in found])
    if abs(gain.value - 1) > max(MAX_SCALE_ERROR, SIGNIFICANT * gain.standard_error):
        figures = {"gain": gain.value, "standard_error": gain.standard_error, "error": gain.value - 1}
        yield Cause(CauseCode.GAIN, 10 * abs(gain.value - 1) / MAX_SCALE_ERROR, figures)
    rubbing = [scale.friction for scale in found if scale.rubs and scale.friction is not None]
    if rubbing:
        mu = max(rubbing, key=lambda each: abs(each.value))
        figures = {"friction": mu.value, "standard_error": mu.standard_error}
        yield Cause(CauseCode.PULLEY, abs(mu.value) / MAX_FRICTION, figures)


def _law_causes(classes: ModelComparison | None, creeps: bool) -> Iterator[Cause]:
    """The extensions that pass the rule, and the runner-up where it explains nearly as much.

    Friction leaves a little that creep takes up: where no hold shows any, friction goes before.
    """
    if classes is None or not classes.chosen:
        return
    gains = {score.name: score.gain for score in classes.ranking}
    best = gains[classes.chosen[0]]
    for name in dict.fromkeys((*classes.chosen, *gains)):
        if name not in classes.chosen and (name not in LAW_CAUSES or gains[name] < 0.8 * best):
            continue
        is_rubbing = name == "creep" and not creeps and "friction" in classes.chosen
        share = 1.0 if name in classes.chosen and not is_rubbing else 0.5
        gain = max(gains[name], GAIN)
        severity = share * gain / (1 - min(gain, 0.99)) / (GAIN / (1 - GAIN))
        yield Cause(LAW_CAUSES[name], severity, {"law": name, "gain": gain})
