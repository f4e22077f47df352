"""Compare constitutive laws of a cuff, Kelvin-Voigt and extensions, by leave-one-repeat-out cross-validation.

Held loads and swings of a donning are fitted together, F = k x + c ẋ + m ẍ + Σ g z, where z is the response of an
extension to the measured history. Every record has its own zero, drift and lag (with its prior), as in the default
estimate. The model is linear except for one parameter of every extension, which is taken from a grid:

    stiffening   z = y², y³, where y is x from the zero of the linear force            (softening if it curves downward)
    friction     z = stop operator of x with limit r, after a play operator that removes noise
    SLS          ż = ẋ − z/T, T up to 1 s              creep     the same with T of 3 s and more
    slip         z = −max(0, highest force so far − limit), over the donning or in every record separately

Every fold leaves one repeat out; coefficients and grid parameters are fitted to the other repeats, and the residual in
this repeat is evaluated. An extension is accepted only if it reduces the mean square by more than 5 % on average and
does not increase it by more than 1 % in any fold. Information criteria accept every extension, because the residuals of
a record are not independent. A second extension must reduce it by another 30 %, because what the stop operator does not
describe of friction leaves up to 21 % to a standard linear solid. Slip occurs in one repeat only, so it is decided by
leaving out stretches of all records, and is then subtracted.

For laws with memory a pull is smoothed and sampled on an even grid.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import chain, product

import numpy as np
import scipy
from numpy.typing import NDArray

from fitting.pull.plateaus import Plateau, is_unloaded
from fitting.pull.pull import Pull
from fitting.trial.bounce import Oscillation
from fitting.trial.clocks import DECLARED
from solver.cuff import KelvinVoigt

KELVIN_VOIGT = "Kelvin-Voigt"
GAIN, SECOND_GAIN, NO_LOSS = 0.05, 0.30, 0.01
"""Required decrease of the mean square for the first and the second extension, and tolerated increase in a fold."""
MOST_EXTENSIONS = 2
FAST, SLOW = (0.03, 0.06, 0.12, 0.25, 0.5, 1.0), (3.0, 6.0, 12.0, 25.0, 50.0)
"""Relaxation times [s] of the standard linear solid and of creep."""
YIELDS = (0.05, 0.1, 0.2, 0.4, 0.8)
"""Limits r of friction over the standard deviation of the displacement."""
LIMITS = tuple(np.linspace(0.05, 0.9, 18).tolist())
"""Limits of slip over the range of the force."""
STRETCH, STRETCHES = 4.0, 5
"""With a single repeat, every fifth stretch of four seconds is left out in turn."""
SLIP, STIFFENING, SOFTENING, FRICTION = "slip", "stiffening", "softening", "friction"
LEAST_SPREAD_RATIO = 0.02
"""Spread of a response over its usual one below which its coefficient is not fitted."""
HELD_WEIGHT = 5.0
"""Weight of a held second relative to a sample of a swing: number of smoothing windows in a second."""
FORCE, X, V, RATE = range(4)
STEP = 0.04
SWING_WINDOW, HELD_WINDOW = 0.2, 1.0
"""Smoothing windows [s] of the displacement: a parabola for a swing, a mean (no overshoot) for held loads."""
SWING_PLAY, HELD_PLAY = 1.0, 3.0
"""Play over the noise of the smoothed displacement, so that noise of a resting cuff is not a reversal of motion."""
LEAST_DECLARED_LAG_SD = 10e-3
"""Least standard uncertainty [s] of a declared lag: the choice of a law must not depend on it."""


@dataclass(frozen=True)
class ClassScore:
    """One law: residual RMS [N] in left-out repeats, and relative decrease of its square against Kelvin-Voigt."""

    name: str
    residual_rms: float
    gain: float


@dataclass(frozen=True)
class ModelComparison:
    """ranking is best first; chosen are the accepted extensions, empty for Kelvin-Voigt."""

    ranking: tuple[ClassScore, ...]
    chosen: tuple[str, ...]

    @property
    def name(self) -> str:
        return " + ".join(self.chosen) or KELVIN_VOIGT

    def as_softening(self) -> ModelComparison:
        """The comparison with stiffening renamed softening."""
        ranking = [replace(score, name=score.name.replace(STIFFENING, SOFTENING)) for score in self.ranking]
        return ModelComparison(tuple(ranking), tuple(SOFTENING if name == STIFFENING else name for name in self.chosen))


def compare_classes(pulls: Sequence[SampledPull]) -> ModelComparison | None:
    """Compare the laws on all records of a donning in time order; None without motion or with a single fold."""
    pulls = [pull for pull in pulls if np.count_nonzero(pull.kept) > 20]
    if not pulls or max(float(np.ptp(pull.force[pull.kept])) for pull in pulls) < 1.0:
        return None
    extensions, columns = _columns(pulls)
    stretches = _cut(pulls, columns, by_stretch=True)
    repeats = {pull.repeat for pull in pulls}
    parts = stretches if len(repeats) == 1 else _cut(pulls, columns, by_stretch=False)
    if min(len({part.fold for part in cut}) for cut in (parts, stretches)) < 2:
        return None  # there is nothing to leave out
    plain = _cross_validate(parts, ())
    if not plain.any():
        return None  # no residual to explain
    scores = {KELVIN_VOIGT: plain, **{extension.name: _cross_validate(parts, (extension,)) for extension in extensions}}
    chosen: tuple[_Extension, ...] = ()
    slip = _established_slip(stretches, extensions)
    if slip is not None:
        chosen, parts = (slip,), _without_extension(parts, slip)
        scores[slip.name] = _cross_validate(parts, ())
    best, limits = scores[_name(chosen)], [GAIN, SECOND_GAIN][len(chosen) :]
    for limit in limits:
        fitted = [extension for extension in chosen if extension is not slip]
        tried = [
            (extension, _cross_validate(parts, (*fitted, extension)) if chosen else scores[extension.name])
            for extension in extensions
            if extension not in chosen
        ]
        extension, residual = min(tried, key=lambda pair: float(pair[1].sum()))
        if not _is_improvement(best, residual, limit):
            break
        chosen, best = (*chosen, extension), residual
        scores[_name(chosen)] = residual
    weight = sum(part.weight for part in parts)
    ranking = [
        ClassScore(name, math.sqrt(float(residual.sum()) / weight), 1 - float(residual.sum() / plain.sum()))
        for name, residual in scores.items()
    ]
    ranking.sort(key=lambda score: score.residual_rms)
    return ModelComparison(tuple(ranking), tuple(extension.name for extension in chosen))


def _name(chosen: Sequence[_Extension]) -> str:
    return " + ".join(extension.name for extension in chosen) or KELVIN_VOIGT


def _established_slip(stretches: Sequence[_Part], extensions: Sequence[_Extension]) -> _Extension | None:
    """Slip if it explains more than any other extension when stretches of all records are left out in turn.

    A cuff slips in the first repeat only, so slip cannot be detected by leaving out repeats.
    """
    residual = {extension.name: _cross_validate(stretches, (extension,)) for extension in extensions}
    best = min(extensions, key=lambda extension: float(residual[extension.name].sum()))
    is_slip = best.name == SLIP and _is_improvement(_cross_validate(stretches, ()), residual[SLIP], GAIN)
    return best if is_slip else None


def _without_extension(parts: Sequence[_Part], extension: _Extension) -> list[_Part]:
    """The parts without the force of the extension, fitted to all of them."""
    whole = np.asarray(sum(part.products for part in parts))
    row = _best(whole, (extension,))
    transform = np.eye(len(whole))
    transform[FORCE, RATE + 1 :] = row[RATE + 1 :]
    return [replace(part, products=transform @ part.products @ transform.T) for part in parts]


def _is_improvement(before: NDArray[np.float64], after: NDArray[np.float64], gain: float) -> bool:
    """Whether the squared residuals of the folds (folds,) decrease enough on average, and increase in none."""
    return bool(after.sum() < (1 - gain) * before.sum() and np.all(after < (1 + NO_LOSS) * before))


@dataclass(frozen=True, eq=False)
class _Extension:
    """An extension: columns of its responses for every grid parameter, and whether its coefficient must be positive."""

    name: str
    choices: tuple[tuple[int, ...], ...]
    is_signed: bool


@dataclass(frozen=True)
class _Part:
    """A fold of a record: products (columns, columns) of its samples without the record's mean, and their weight."""

    fold: int
    weight: float
    products: NDArray[np.float64]


def _columns(pulls: Sequence[SampledPull]) -> tuple[list[_Extension], list[NDArray[np.float64]]]:
    """The extensions, and columns (n, columns) of every record: force, displacement, velocity, force rate, responses.

    All except the force and its rate are scaled to unit spread over the kept samples.
    """
    columns = [[pull.force, pull.displacement, pull.velocity, pull.force_rate] for pull in pulls]
    extensions = []
    for name, responses in _responses(pulls).items():
        choices = []
        for response in responses:
            first = len(columns[0])
            for mine, added in zip(columns, response, strict=True):
                mine.extend(added)
            choices.append(tuple(range(first, len(columns[0]))))
        extensions.append(_Extension(name, tuple(choices), name != STIFFENING))
    whole = [np.column_stack(mine) for mine in columns]
    spread = np.std(np.concatenate([mine[pull.kept] for pull, mine in zip(pulls, whole, strict=True)]), axis=0)
    spread[[FORCE, RATE]], spread[spread == 0] = 1.0, 1.0
    return extensions, [mine / spread for mine in whole]


def _cut(pulls: Sequence[SampledPull], columns: Sequence[NDArray[np.float64]], *, by_stretch: bool) -> list[_Part]:
    """Divide the records into folds: repeats, or every fifth stretch of four seconds."""
    parts = []
    for pull, mine in zip(pulls, columns, strict=True):
        time, rows = pull.time[pull.kept], mine[pull.kept]
        if pull.is_held:
            time, rows = _whole_seconds(time, rows)
        weight = HELD_WEIGHT if pull.is_held else 1.0
        rows = _without_nuisance(time, rows, pull)
        folds = (time // STRETCH).astype(np.intp) % STRETCHES if by_stretch else np.full(len(rows), pull.repeat)
        for fold in np.unique(folds):
            piece = rows[folds == fold]
            parts.append(_Part(int(fold), weight * len(piece), weight * piece.T @ piece))
    return parts


def _without_nuisance(time: NDArray[np.float64], rows: NDArray[np.float64], pull: SampledPull) -> NDArray[np.float64]:
    """Rows (n, columns) without the parts explained by the record's zero, drift and lag (with its prior).

    The penalty of a lag τ is (τ/lag_sd)², in units of the residual variance of a spring and a damper in this record.
    """
    zero = np.vander(time - time.mean(), 2 if pull.drifts else 1)
    rows = rows - zero @ np.linalg.lstsq(zero, rows, rcond=None)[0]
    rate = rows[:, RATE].copy()
    power = float(rate @ rate)
    if pull.lag_sd == 0 or power == 0:
        return rows
    law = rows[:, [X, V, RATE]]
    residual = rows[:, FORCE] - law @ np.linalg.lstsq(law, rows[:, FORCE], rcond=None)[0]
    penalty = float(residual @ residual) / len(residual) / pull.lag_sd**2
    # Minimised over τ, the squares along the rate are reduced by 1 − share, so the rows by its root.
    share = power / (power + penalty)
    return np.asarray(rows - (1 - math.sqrt(1 - share)) * np.outer(rate, rate @ rows) / power)


def _whole_seconds(
    time: NDArray[np.float64], rows: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Means over seconds with most samples kept; noise of a resting cuff would otherwise be fitted as small motion."""
    second, index, count = np.unique(np.floor(time), return_inverse=True, return_counts=True)
    total = np.zeros((len(second), rows.shape[1]))
    np.add.at(total, index, rows)
    is_whole = count > 0.5 * count.max()
    return second[is_whole], total[is_whole] / count[is_whole, None]


def _cross_validate(parts: Sequence[_Part], extensions: Sequence[_Extension]) -> NDArray[np.float64]:
    """Squared residuals in every fold (folds,) [N²] of the law fitted to the other folds."""
    residual = []
    for fold in sorted({part.fold for part in parts}):
        inside = sum(part.products for part in parts if part.fold == fold)
        row = _best(np.asarray(sum(part.products for part in parts if part.fold != fold)), extensions)
        residual.append(max(0.0, float(row @ inside @ row)))  # rounding may give a negative zero
    return np.array(residual)


def _best(products: NDArray[np.float64], extensions: Sequence[_Extension]) -> NDArray[np.float64]:
    """The row that maps columns to the residual force, for the best grid parameters with admissible signs.

    1 for the force and minus the coefficients elsewhere.
    """
    grid = [[X, V, *chain(*chosen)] for chosen in product(*(extension.choices for extension in extensions))]
    is_signed = [False, False, *(extension.is_signed for extension in extensions for _ in extension.choices[0])]
    used = np.array(grid)  # (choices, coefficients)
    scale = np.sqrt(np.diag(products)[used])
    scale[scale < LEAST_SPREAD_RATIO * scale[:, :1]] = np.inf
    normal = products[used[:, :, None], used[:, None, :]] / (scale[:, :, None] * scale[:, None, :])
    inverse = np.linalg.pinv(normal, rcond=1e-9, hermitian=True)
    solved = np.einsum("gij,gj->gi", inverse, products[used, FORCE] / scale) / scale
    rows = np.zeros((len(used), len(products)))
    rows[:, FORCE] = 1.0
    np.put_along_axis(rows, used, -solved, axis=1)
    is_admissible = np.all(solved[:, is_signed] >= 0, axis=1)
    if not is_admissible.any():
        return _best(products, extensions[:-1])
    squares = np.einsum("gi,gi->g", rows @ products, rows)
    return np.asarray(rows[np.argmin(np.where(is_admissible, squares, np.inf))])


def _responses(pulls: Sequence[SampledPull]) -> Mapping[str, list[list[list[NDArray[np.float64]]]]]:
    """Extension → grid parameter → record → columns (n,)."""
    spread = float(np.std(np.concatenate([pull.displacement[pull.kept] for pull in pulls])))
    plays = [_play(pull) for pull in pulls]
    return {
        STIFFENING: [[_powers(pull, _stiffness(pulls)) for pull in pulls]],
        FRICTION: [[[_stop(play, part * spread)] for play in plays] for part in YIELDS],
        "standard linear solid": [[[_relax(pull, time)] for pull in pulls] for time in FAST],
        "creep": [[[_relax(pull, time)] for pull in pulls] for time in SLOW],
        SLIP: [[[column] for column in columns] for columns in _slips(pulls)],
    }


def _stiffness(pulls: Sequence[SampledPull]) -> float:
    force, x = (
        np.concatenate([values[pull.kept] - values[pull.kept].mean() for pull, values in pairs])
        for pairs in ([(e, e.force) for e in pulls], [(e, e.displacement) for e in pulls])
    )
    return float(force @ x / (x @ x))


def _powers(pull: SampledPull, stiffness: float) -> list[NDArray[np.float64]]:
    x, force = pull.displacement, pull.force
    y = x - x[pull.kept].mean() + KelvinVoigt(stiffness).equilibrium(force[pull.kept].mean())
    return [y**2, y**3]


def _play(pull: SampledPull) -> list[float]:
    """Increments (n,) [m] of the displacement after a play operator, which removes its noise."""
    output = float(pull.displacement[0])
    increments = []
    for x in pull.displacement.tolist():
        moved = max(x - pull.play, min(output, x + pull.play)) - output
        output += moved
        increments.append(moved)
    return increments


def _stop(increments: Sequence[float], reach: float) -> NDArray[np.float64]:
    """Stop operator with limit `reach`, of increments (n,)."""
    z, found = 0.0, []
    for moved in increments:
        z += moved
        if z > reach:
            z = reach
        elif z < -reach:
            z = -reach
        found.append(z)
    return np.array(found)


def _relax(pull: SampledPull, time: float) -> NDArray[np.float64]:
    """z with ż = ẋ − z/T, initially at rest."""
    step = pull.time[1] - pull.time[0]
    decay = math.exp(-step / time)
    moved = np.diff(pull.displacement, prepend=pull.displacement[0])
    return np.asarray(scipy.signal.lfilter([time / step * (1 - decay)], [1, -decay], moved))


def _slips(pulls: Sequence[SampledPull]) -> Iterator[list[NDArray[np.float64]]]:
    """−max(0, highest force so far − limit) for every limit, over all previous records or over this one only."""
    runs = [np.maximum.accumulate(pull.force) for pull in pulls]
    before = np.concatenate(([-np.inf], np.maximum.accumulate([run[-1] for run in runs])[:-1]))
    low, high = min(float(run[0]) for run in runs), max(float(run[-1]) for run in runs)
    for part in LIMITS:
        limit = low + part * (high - low)
        for highest in ([np.maximum(run, b) for run, b in zip(runs, before, strict=True)], runs):
            yield [-np.maximum(0.0, run - limit) for run in highest]


@dataclass(frozen=True)
class SampledPull:
    """A pull on an even grid [s]: force (n,) [N], displacement (n,) [m] and velocity (n,) [m/s] without NaN.

    force      without the inertia of the cuff, and without the drift of the cell's zero if the trial determines it
    drifts     whether the trial does not determine the drift, so that the force may contain it
    force_rate (n,) [N/s], derivative of the force with respect to the lag
    lag_sd     standard uncertainty [s] of the lag of force against markers
    kept       (n,) samples that are used: held loads, or the swing
    is_held    whether the samples are held loads, of which means over seconds are used
    repeat     number of the repeat; all pulls of a repeat are left out together
    play       [m] of the play operator, above the noise of the displacement
    """

    time: NDArray[np.float64]
    force: NDArray[np.float64]
    drifts: bool
    force_rate: NDArray[np.float64]
    lag_sd: float
    displacement: NDArray[np.float64]
    velocity: NDArray[np.float64]
    kept: NDArray[np.bool_]
    is_held: bool
    repeat: int
    play: float


def sample_pull(pull: Pull, held: Sequence[Plateau], swing: Oscillation | None) -> SampledPull:
    """Sample a pull with its held loads or its swing; hidden frames are interpolated linearly.

    Samples in gaps longer than half a smoothing window are not kept: there the line is no displacement of the cuff.
    """
    seen = np.isfinite(pull.displacement)
    frame = float(np.median(np.diff(pull.marker_time)))
    filled = np.interp(pull.marker_time, pull.marker_time[seen], pull.displacement[seen])
    is_held = swing is None
    longest = 2 * ((len(filled) - 1) // 2) + 1  # for a short record
    window = max(5, min(longest, 2 * round((HELD_WINDOW if is_held else SWING_WINDOW) / frame / 2) + 1))
    gaps = scipy.ndimage.binary_opening(~seen, np.ones(window // 2, bool))
    smoothed_over = scipy.ndimage.binary_dilation(gaps, np.ones(window, bool)).astype(float)
    smooth = scipy.signal.savgol_filter(filled, window, 0 if is_held else 2)
    speed = scipy.signal.savgol_filter(filled, window, 2, deriv=1, delta=frame)
    step = max(STEP, float(np.median(np.diff(pull.force_time))))
    first = max(pull.force_time[0], pull.marker_time[0])
    time = np.arange(first, min(pull.force_time[-1], pull.marker_time[-1]), step)
    drift = _zero_rate(pull, held)
    force = _averaged(pull.force_time, pull.force, time, step) - (drift or 0.0) * (time - first)
    if not is_held:
        inertia = pull.trial.cuff_mass * scipy.signal.savgol_filter(filled, window, 2, deriv=2, delta=frame)
        force = force - np.interp(time, pull.marker_time, inertia)
    return SampledPull(
        time=time,
        force=force,
        drifts=drift is None,
        force_rate=np.gradient(force, step),
        lag_sd=0.0 if swing is None else _lag_sd(pull, swing),
        displacement=np.interp(time, pull.marker_time, smooth),
        velocity=np.interp(time, pull.marker_time, speed),
        kept=_kept(time, held, swing) & (np.interp(time, pull.marker_time, smoothed_over) == 0),
        is_held=is_held,
        repeat=pull.trial.repeat,
        play=(HELD_PLAY if is_held else SWING_PLAY) * _noise_left(filled - smooth, window, 0 if is_held else 2),
    )


def _zero_rate(pull: Pull, held: Sequence[Plateau]) -> float | None:
    """Drift of the cell's zero [N/s] from held loads that start and end with the bare hook; otherwise None."""
    if len(held) < 3 or not is_unloaded(held[0], held) or not is_unloaded(held[-1], held):
        return None
    ends = [(pull.force_time >= plateau.start) & (pull.force_time <= plateau.end) for plateau in (held[0], held[-1])]
    time, force = ([float(np.mean(values[end])) for end in ends] for values in (pull.force_time, pull.force))
    return (force[1] - force[0]) / (time[1] - time[0])


def _lag_sd(pull: Pull, swing: Oscillation) -> float:
    """Standard uncertainty [s] of the lag, at least LEAST_DECLARED_LAG_SD for a declared one."""
    lag = pull.trial.lag
    known = lag.total(swing.middle)
    return max(known, LEAST_DECLARED_LAG_SD) if lag.source == DECLARED else known


def _averaged(
    time: NDArray[np.float64], values: NDArray[np.float64], at: NDArray[np.float64], width: float
) -> NDArray[np.float64]:
    """Means of the values within half a width of every instant; interpolated values if there are too few."""
    total = np.concatenate(([0.0], np.cumsum(values)))
    low, high = np.searchsorted(time, at - width / 2), np.searchsorted(time, at + width / 2)
    count = high - low
    means = (total[high] - total[low]) / np.maximum(count, 1)
    return np.where(count >= 4, means, np.interp(at, time, values))


def _kept(time: NDArray[np.float64], held: Sequence[Plateau], swing: Oscillation | None) -> NDArray[np.bool_]:
    if swing is not None:
        return np.asarray((time >= swing.start) & (time <= swing.end))
    stretches = ((time >= plateau.start) & (time <= plateau.end) for plateau in held)
    return np.asarray(sum(stretches, np.zeros(len(time), bool)))


def _noise_left(residual: NDArray[np.float64], window: int, order: int) -> float:
    """Standard deviation of white noise in the smoothed displacement, from the residual of the smoothing."""
    kept = float(scipy.signal.savgol_coeffs(window, order)[window // 2])
    removed = 1.4826 * float(np.median(np.abs(residual)))
    return removed * math.sqrt(kept / (1 - kept))
