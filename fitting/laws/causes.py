"""What may be wrong with a rig, or richer in a cuff, with what it means for the figures and what to do next.

Offsets of force or place (a tare with the weight on, drift of the zero, another zero of x, migration) are the causes
that make F − k x negative throughout; lag, relaxation and friction do not. Laws richer than a spring and a damper are
named by the comparison of classes, causes in the rig by D6, D7, the protocol's weights and the anchor markers.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from fitting.curves import TrialCurves
from fitting.laws.findings import ANGLE_LIMIT, SHIFT_LIMIT, SIGNIFICANT, ZERO_LIMIT, Finding
from fitting.laws.levels import swing_force
from fitting.laws.model_class import GAIN, ModelComparison
from fitting.markers.loose import LOOSE
from fitting.quality import SKIN_CORRELATION
from fitting.static.steps import MAX_FRICTION, MAX_SCALE_ERROR, load_scale
from fitting.uncertainty import Repeat, combine

TARED_BELOW = 0.5
"""Of the swing's amplitude: a mean force nearer to zero than that was tared away."""
STANDS = "k and c stand, as each record has a zero of its own"
ADVICE = {
    "tare with the weight on": f"{STANDS}; tare with the bare hook",
    "zero drift of the load cell": f"{STANDS}; let the cell and its amplifier warm up",
    "zero of the displacement": f"{STANDS}; leave cuff and anchor markers alone between the trials",
    "stiffening": "k is the mean slope; read the tangent at the load that matters (exponential_law in cuffs.json)",
    "softening": "k is the mean slope; read the tangent at the load that matters (exponential_law in cuffs.json)",
    "friction": "c is what the swing's amplitude and frequency make of it, no damper's; swing as the suit will",
    "standard linear solid": "k and c are those of the swing's frequency (complex_stiffness in cuffs.json); swing as "
    "fast as the suit will",
    "creep": "k is that of the holds' length; hold as long as the suit will, and wait before migration is read",
    "slip": "k is from where it held; fasten the cuff tighter, or load it once before the first trial",
}
"""What a cause means for the figures, and what to do."""


@dataclass(frozen=True)
class Cause:
    """What may be wrong; severity is how many times the figure behind it exceeds what is worth a word."""

    name: str
    severity: float
    sentence: str


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
    by_name = {finding.name: finding for finding in findings}
    bare = [each.static.plateaus[0].force for each in static if each.static]
    tared = any(_is_tared(each, bare) for each in dynamic)
    angle = by_name.get("angle of the pulls")
    if angle and angle.is_alarm:
        words = f"{angle.sentence}: k and c are those of two directions; pull both along one, with markers on the rope"
        yield Cause("direction of the pull", 10 * angle.value / ANGLE_LIMIT, words)
    force, place = by_name.get("unloaded force between records"), by_name.get("unloaded place between records")
    if force is None or place is None:
        yield from _unseen(by_name.get("start from the static zero"), tared)
        return
    if force.is_alarm:
        severity = abs(force.value) / ZERO_LIMIT
        names = ("tare with the weight on", "zero drift of the load cell")
        for name, share in zip(names if tared else names[::-1], (1.0, 0.1), strict=True):
            yield Cause(name, share * severity, f"{name}: {force.sentence}; {ADVICE[name]}")
    if place.is_alarm:
        name = "zero of the displacement"
        words = f"{name}: {place.sentence}, as it was moved or x has another zero there; {ADVICE[name]}"
        yield Cause(name, abs(place.value) / SHIFT_LIMIT, words)


def _unseen(place: Finding | None, tared: bool) -> Iterator[Cause]:
    """Without an unloaded stretch an offset may be one of force or of place."""
    if place is None or not place.is_alarm:
        return
    severity = abs(place.value) / SHIFT_LIMIT
    names = ["zero of the displacement", "zero drift of the load cell"]
    if tared:
        names.insert(0, "tare with the weight on")
    for rank, name in enumerate(names):
        words = f"{name}: {place.sentence}, or the force has another zero; {ADVICE[name]}"
        yield Cause(name, severity * 0.9**rank, words)


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
        words = (
            f"{label} moves by {1e3 * way:.1f} mm rms among the other anchor markers: the cuff's way is that much less "
            "sure; fix it, or leave it out of anchor_markers"
        )
        yield Cause("loose anchor marker", way / LOOSE, words)
    follows = [each.markers.anchor_follows_force for each in curves if each.markers is not None]
    if follows and float(np.mean(follows)) > SKIN_CORRELATION:
        words = (
            f"the anchor markers deform with the load (correlation {np.mean(follows):.2f}): skin moves "
            "under one, and k is off by as much; fix that marker to bone or to a plate, and record again"
        )
        yield Cause("skin under an anchor marker", 10 * float(np.mean(follows)) / SKIN_CORRELATION, words)


def _weights(static: Sequence[TrialCurves]) -> Iterator[Cause]:
    """What the protocol's weights say of the load cell's scale and of the pulley."""
    scales = [load_scale(each.static.plateaus, each.trial.step_masses) for each in static if each.static]
    found = [scale for scale in scales if scale is not None]
    if not found:
        return
    gain = combine([Repeat(scale.gain.value, scale.gain.standard_error) for scale in found])
    if abs(gain.value - 1) > max(MAX_SCALE_ERROR, SIGNIFICANT * gain.standard_error):
        words = (
            f"the load cell reads {gain.value:.4f} ± {gain.standard_error:.4f} newtons for each that the protocol's "
            f"weights pull with: k and c are {100 * (gain.value - 1):+.1f} % off, unless the weights are; hang on a "
            "known mass (station check --known-mass)"
        )
        yield Cause("gain of the load cell", 10 * abs(gain.value - 1) / MAX_SCALE_ERROR, words)
    rubbing = [scale.friction for scale in found if scale.rubs and scale.friction is not None]
    if rubbing:
        mu = max(rubbing, key=lambda each: abs(each.value))
        words = f"the pulley holds back {100 * mu.value:.1f} ± {100 * mu.standard_error:.1f} % of the load; oil it"
        yield Cause("friction of the pulley", abs(mu.value) / MAX_FRICTION, words)


def _law_causes(classes: ModelComparison | None, creeps: bool) -> Iterator[Cause]:
    """The extensions that pass the rule, and the runner-up where it explains nearly as much.

    Friction leaves a little that creep takes up: where no hold shows any, friction goes before.
    """
    if classes is None or not classes.chosen:
        return
    gains = {score.name: score.gain for score in classes.ranking}
    best = gains[classes.chosen[0]]
    for name in dict.fromkeys((*classes.chosen, *gains)):
        if name not in classes.chosen and (name not in ADVICE or gains[name] < 0.8 * best):
            continue
        is_rubbing = name == "creep" and not creeps and "friction" in classes.chosen
        share = 1.0 if name in classes.chosen and not is_rubbing else 0.5
        gain = max(gains[name], GAIN)
        words = f"{name} explains {100 * gain:.0f} % of what a spring and a damper leave over; {ADVICE[name]}"
        yield Cause(name, share * gain / (1 - min(gain, 0.99)) / (GAIN / (1 - GAIN)), words)
