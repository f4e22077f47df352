"""Stiffness from held loads: the slope of force over displacement where the cuff did not slip.

A cuff slips while the load rises beyond what it has carried, and holds below. So the plateaus of a trial fall into
segments, each with an offset of its own; a new one begins when the load exceeds all loads before in the donning. The
slope within the segments is the stiffness, the way from one offset to the next is slip.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import combinations, pairwise
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from scipy import stats

from fitting.outcome import NEGLIGIBLE, FitOutcome, worst
from fitting.quality import UnusableTrial
from fitting.static.plateaus import Plateau
from fitting.static.tangent import HeldPoints, TangentLaw, fit_law, within
from fitting.uncertainty import NORMAL_95, Estimate, Repeat, as_inverse, combine

SAME_LOAD = 0.3
"""Newtons by which a load may exceed the highest before and still count as the same weights hung on again."""
MIN_STRAIGHT = 2
"""Plateaus beyond two that a line must meet before the cuff is believed not to have slipped."""
BELIEVED = 0.999
"""Probability of χ² up to which a line or a curve is believed."""
INCONSISTENT = 3.0
"""Combined standard errors between unloading and reloading beyond which reloading slips, too."""
MOST_FRICTION = 0.1
"""Part of the load by which a cuff may rub unnoticed: more would hold it against half of what a usual swing pulls. What
is left behind beyond what that explains, the cuff slipped."""
ROUNDS, MAX_ROUNDS = 4, 40
"""Of the weights: at least so many, and then until the compliance rests."""
LEAST_SD = 1e-7
"""Metres: no marker is placed better, whatever a stream that stands still claims."""


@dataclass(frozen=True)
class StaticFit:
    """What one static trial says.

    plateaus  in time order
    segment   (plateaus,) number of each plateau's segment
    offset    (plateaus,) N: force = k x + offset along the plateau's segment
    repeat    compliance 1/k [m/N] of this trial, None if no segment holds two different loads
    x, x_sd   (plateaus,) m: displacement as it was read, and its error with that of the force in it
    outcome   of the rounds of the weights
    """

    plateaus: tuple[Plateau, ...]
    segment: NDArray[np.intp]
    offset: NDArray[np.float64]
    repeat: Repeat | None
    x: NDArray[np.float64]
    x_sd: NDArray[np.float64]
    outcome: FitOutcome = FitOutcome.CONVERGED


@dataclass(frozen=True)
class StiffnessFit:
    """k [N/m] of a donning from all its static trials, None if the load only rose and the cuff may have slipped.

    slip        m by which the cuff gave way for good while the load rose, summed over the donning
    slips_again is True if even loads carried before made it slip, so that only unloading was used
    further     m by which the same load then holds it further out from trial to trial; 0 if it comes back in between
    friction    N by which it rubs: so much more holds it while the load rises, so much less while it falls; 0 if not
    only_rose   is True if no load was taken off or put on again
    law         tangent stiffness over the load, None if the loads are too few to bend it
    if_rubs     k [N/m] if the cuff rubs and has not slipped, where nothing tells which; it is in the interval then
    outcome     of all iterations that k rests on
    """

    stiffness: Estimate | None
    trials: tuple[StaticFit, ...]
    slip: float
    slips_again: bool
    further: float
    friction: float
    only_rose: bool
    law: TangentLaw | None
    if_rubs: Estimate | None = None
    outcome: FitOutcome = FitOutcome.CONVERGED


def require_positive_loads(plateaus: Sequence[Plateau]) -> None:
    """Raises UnusableTrial if hanging weights on made the force fall: the load cell's sign is wrong."""
    if not plateaus:
        return
    start = plateaus[0].force
    largest = max(plateaus, key=lambda plateau: abs(plateau.force - start))
    if largest.force < start - 5 * max(largest.force_sd, 0.1) and largest.force < 0:
        raise UnusableTrial(
            f"force falls from {start:.1f} N to {largest.force:.1f} N when the load is put on, expected a rise; "
            "set load_cell.polarity to the other sign"
        )


def fit_stiffness(
    trials: Sequence[Sequence[Plateau]], gain_sd: float, drift_sd: float = 0.0, *, creeps: bool = False
) -> StiffnessFit:
    """k of one donning from the plateaus of its static trials in time order.

    gain_sd is the relative standard uncertainty of the load cell's scale, drift_sd [N/s] what is not known of how its
    zero wanders; creeps tells that what bends the line is creep, and no slip.
    """
    fits = _fit_trials(trials, gain_sd, drift_sd, "above all before")
    every_rise = _fit_trials(trials, gain_sd, drift_sd, "every rise")
    unslipped = _fit_trials(trials, gain_sd, drift_sd, "nowhere")
    turned = _fit_trials(trials, gain_sd, drift_sd, "at turns")
    slips_again, friction = _contradict(fits, every_rise), 0.0
    fits = every_rise if slips_again else fits
    only_rose = not any(fit.repeat for fit in fits)
    one_way_back = None
    if creeps or _retraces(unslipped) or _holds(unslipped, fit_law(_points(unslipped)), only_rose):
        fits, slips_again = unslipped, False
    elif _is_straight(turned) and (friction := _friction(turned)) > 0:
        fits, slips_again = turned, False
    else:
        one_way_back = _if_it_rubs(fits, turned)
    repeats = [fit.repeat for fit in fits if fit.repeat is not None]
    stiffness = as_inverse(combine(repeats)) if repeats else None
    slip = sum(_slip(fit, stiffness.value) for fit in fits) if stiffness and not friction else 0.0
    law = fit_law(_points(fits), gain_sd) if repeats else None
    further = _further(trials, stiffness.value) if slips_again and stiffness else 0.0
    if stiffness and one_way_back:
        stiffness = _reaching(stiffness, one_way_back)
    outcome = worst([fit.outcome for fit in fits] + ([law.outcome] if law else []))
    return StiffnessFit(
        stiffness, tuple(fits), slip, slips_again, further, friction, only_rose, law, one_way_back, outcome
    )


def trial_stiffness(fit: StaticFit, if_rubs: Estimate | None = None) -> Estimate | None:
    """k [N/m] from this trial alone, None if its interval has no end; if_rubs as in the donning's StiffnessFit."""
    stiffness = as_inverse(fit.repeat.estimate) if fit.repeat else None
    if stiffness is None or not math.isfinite(stiffness.ci95[1]):
        return None
    return _reaching(stiffness, if_rubs) if if_rubs else stiffness


def _fit_trials(
    trials: Sequence[Sequence[Plateau]],
    gain_sd: float,
    drift_sd: float,
    slips: Literal["nowhere", "above all before", "every rise", "at turns"],
) -> list[StaticFit]:
    """Every trial with segments that begin where the cuff is taken to slip; a trial's first plateau begins none.

    At turns: where the load begins to rise or to fall, as of a cuff that rubs.
    """
    highest = -math.inf
    fits = []
    for plateaus in trials:
        begins = np.zeros(len(plateaus), bool)
        goes = np.sign(np.diff([plateau.force for plateau in plateaus]))
        for i, plateau in enumerate(plateaus):
            if slips == "at turns":
                begins[i] = i == 1 or (i > 1 and goes[i - 1] != goes[i - 2])
                continue
            before = {"nowhere": math.inf, "above all before": highest, "every rise": plateaus[i - 1].force}[slips]
            begins[i] = i > 0 and plateau.force > before + SAME_LOAD
            highest = max(highest, plateau.force)
        fits.append(_fit_trial(tuple(plateaus), begins, gain_sd, drift_sd))
    return fits


def _holds(unslipped: Sequence[StaticFit], law: TangentLaw | None, only_rose: bool) -> bool:
    """Whether the loads lie on one line, or one exponential, within their errors: then the cuff did not slip.

    Of a load that only rose a curve that softens is not believed: slip bends it as well.
    """
    if sum(fit.repeat.dof for fit in unslipped if fit.repeat) < MIN_STRAIGHT:
        return False
    if _is_straight(unslipped):
        return True
    if law is None or law.outcome is not FitOutcome.CONVERGED:
        return False
    return law.chi_square < float(stats.chi2.ppf(BELIEVED, law.dof)) and (not only_rose or law.growth > 0)


def _is_straight(fits: Sequence[StaticFit]) -> bool:
    """Whether the loads of each segment lie on a line within their errors."""
    repeats = [fit.repeat for fit in fits if fit.repeat is not None]
    dof = sum(repeat.dof for repeat in repeats)
    return dof >= MIN_STRAIGHT and sum(repeat.chi_square for repeat in repeats) < stats.chi2.ppf(BELIEVED, dof)


def _friction(turned: Sequence[StaticFit]) -> float:
    """Half of what the line of rising loads lies above that of falling ones [N]; 0 unless it does so in every trial.

    Two loads each way must show the slope: one way back may as well be that of a cuff that slipped.
    """
    found = []
    for fit in turned:
        ahead = np.diff([plateau.force for plateau in fit.plateaus], prepend=np.nan) > 0
        rising, falling = fit.offset[1:][ahead[1:]], fit.offset[1:][~ahead[1:]]
        if min(len(rising), len(falling)) < 2:
            return 0.0
        found.append(float(rising.mean() - falling.mean()) / 2)
    return float(np.mean(found)) if found and min(found) > 0 else 0.0


def _if_it_rubs(fits: Sequence[StaticFit], turned: Sequence[StaticFit]) -> Estimate | None:
    """k [N/m] along the rising loads, where friction explains the one way back as well as slip; None where it cannot.

    Loads that come off at once lead back once: along k if the cuff slipped before, and with twice its friction to
    overcome if it rubs. Loads carried before, on one line with the way back, a bend on the way out, or a way out that
    is far less steep speak for slip.
    """
    found, risen = [fit.repeat for fit in fits if fit.repeat], [fit.repeat for fit in turned if fit.repeat]
    if not found or not risen or any(_falls(fit.plateaus) > 1 for fit in fits):
        return None
    dof, chi_square = sum(each.dof for each in risen), sum(each.chi_square for each in risen)
    if _is_straight(fits) or (dof > 0 and chi_square > stats.chi2.ppf(BELIEVED, dof)):
        return None
    stiffness, rubbing = as_inverse(combine(found)), as_inverse(combine(risen))
    return rubbing if stiffness.value * (1 - 2 * MOST_FRICTION) < rubbing.value < stiffness.value else None


def _falls(plateaus: Sequence[Plateau]) -> int:
    return sum(b.force < a.force - SAME_LOAD for a, b in pairwise(plateaus))


def _reaching(stiffness: Estimate, other: Estimate) -> Estimate:
    """The stiffness with an interval that reaches the other, too; either may be true, and all between."""
    low = min(stiffness.ci95[0], other.value - NORMAL_95 * other.standard_error)
    part = max(0.0, stiffness.value - other.value) / math.sqrt(3)
    return replace(
        stiffness,
        standard_error=math.hypot(stiffness.standard_error, part),
        ci95=(low, stiffness.ci95[1]),
        parts={**stiffness.parts, "friction": part},
    )


def _further(trials: Sequence[Sequence[Plateau]], stiffness: float) -> float:
    """How much further out the highest load common to trials holds the cuff in the last than in the first [m].

    0 unless the noise is far below it.
    """
    held = [plateaus for plateaus in trials if plateaus]
    top = min(max(plateau.force for plateau in plateaus) for plateaus in held)
    first, last = (min(plateaus, key=lambda each: abs(each.force - top)) for plateaus in (held[0], held[-1]))
    further = last.late[0] - first.late[0] - (last.force - first.force) / stiffness
    error = math.hypot(first.late[1], last.late[1])
    return further if further > INCONSISTENT * error else 0.0


def _retraces(unslipped: Sequence[StaticFit]) -> bool:
    """Whether each trial comes back to where it was under the same loads: then the cuff bends, in whatever way."""
    chi_square, count = 0.0, 0
    for fit in unslipped:
        force = np.array([plateau.force for plateau in fit.plateaus])
        pairs = [(i, j) for i, j in combinations(range(len(force)), 2) if _comes_back(force[i : j + 1])]
        if fit.repeat is None or not pairs:
            return False
        for i, j in pairs:
            way = fit.x[j] - fit.x[i] - fit.repeat.value * (force[j] - force[i])
            chi_square += float(way**2 / (fit.x_sd[i] ** 2 + fit.x_sd[j] ** 2))
        count += len(pairs)
    return count > 0 and chi_square < float(stats.chi2.ppf(BELIEVED, count))


def _comes_back(force: NDArray[np.float64]) -> bool:
    """Whether loads (n,) [N] end as they began, having risen and never fallen below in between."""
    first, last = force[0], force[-1]
    return bool(
        abs(last - first) < SAME_LOAD and force.max() > max(first, last) + SAME_LOAD and force.min() > first - SAME_LOAD
    )


def _points(fits: Sequence[StaticFit]) -> HeldPoints:
    """The plateaus of all trials; segments of different trials share no offset."""
    firsts = np.cumsum([0, *(int(fit.segment.max(initial=-1)) + 1 for fit in fits)])
    group = [fit.segment + first for fit, first in zip(fits, firsts, strict=False)]
    force = [np.array([plateau.force for plateau in fit.plateaus]) for fit in fits]
    return HeldPoints(
        np.concatenate([*force, np.zeros(0)]),
        np.concatenate([*(fit.x for fit in fits), np.zeros(0)]),
        np.concatenate([*(fit.x_sd for fit in fits), np.zeros(0)]),
        np.concatenate([*group, np.zeros(0)]).astype(np.intp),
    )


def _fit_trial(plateaus: tuple[Plateau, ...], begins: NDArray[np.bool_], gain_sd: float, drift_sd: float) -> StaticFit:
    """Weighted regression of displacement on force within segments: force is by far the better known of the two.

    Weights are of the effective variance u(x)² + u(F)²/k² (York), with 1/k from the round before.
    """
    segment = np.cumsum(begins, dtype=np.intp)
    force = np.array([plateau.force for plateau in plateaus])
    force_sd = np.array([plateau.force_sd for plateau in plateaus])
    read = [
        plateau.late if slipped else (plateau.displacement, plateau.displacement_sd)
        for plateau, slipped in zip(plateaus, begins, strict=True)
    ]
    x, x_sd = np.array(read).reshape(-1, 2).T
    x_sd = np.maximum(x_sd, LEAST_SD)
    dof = len(plateaus) - len(np.unique(segment)) - 1
    if dof < 0 or not any(np.ptp(force[segment == s]) > SAME_LOAD for s in np.unique(segment)):
        return StaticFit(plateaus, segment, np.full(len(plateaus), np.nan), None, x, x_sd)
    compliance, outcome = 0.0, FitOutcome.NOT_CONVERGED
    for count in range(1, MAX_ROUNDS + 1):
        weight = 1 / (x_sd**2 + (compliance * force_sd) ** 2)
        way, load = within(x, segment, weight), within(force, segment, weight)
        information = float(weight @ load**2)
        before, compliance = compliance, float(weight @ (load * way)) / information
        if count >= ROUNDS and (compliance - before) ** 2 * information <= NEGLIGIBLE**2:
            outcome = FitOutcome.CONVERGED
            break
    chi_square = float(weight @ (way - compliance * load) ** 2)
    codes = np.array([plateau.codes for plateau in plateaus])
    white = 1 / (x_sd**2 + compliance**2 * (force_sd**2 - codes**2))
    noise = 1 / math.sqrt(float(white @ within(force, segment, white) ** 2))
    middle = np.array([(plateau.start + plateau.end) / 2 for plateau in plateaus])
    # A zero that drifts by d [N/s] adds d t to the load, and so Σ w load t / Σ w load² of itself to the compliance.
    leverage = abs(float(weight @ (load * within(middle, segment, weight)))) / information
    causes = {
        "codes": math.sqrt(max(0.0, 1 / information - noise**2)),
        "gain": gain_sd * abs(compliance),
        "drift": drift_sd * leverage * abs(compliance),
    }
    repeat = Repeat(compliance, noise, math.hypot(*causes.values()), chi_square, max(dof, 0), causes)
    offset = (force - load) - (x - way) / compliance
    return StaticFit(plateaus, segment, offset, repeat, x, np.hypot(x_sd, compliance * force_sd), outcome)


def _contradict(above_all: list[StaticFit], every_rise: list[StaticFit]) -> bool:
    """Whether loads that were carried before give another compliance going up than coming down (Hausman's test)."""
    tight = [fit.repeat for fit in above_all if fit.repeat is not None]
    safe = [fit.repeat for fit in every_rise if fit.repeat is not None]
    if not tight or not safe:
        return False
    one, other = combine(tight), combine(safe)
    error = math.sqrt(max(other.standard_error**2 - one.standard_error**2, (0.3 * other.standard_error) ** 2))
    return abs(one.value - other.value) > INCONSISTENT * error


def _slip(fit: StaticFit, stiffness: float) -> float:
    """How far the offsets wandered in a trial [m]."""
    if not len(fit.plateaus):
        return 0.0
    x = np.array([plateau.late[0] - plateau.force / stiffness for plateau in fit.plateaus])
    return float(sum(x[i] - x[i - 1] for i in np.flatnonzero(np.diff(fit.segment)) + 1))
