"""Which law a cuff follows: Kelvin-Voigt and what may come on top of it, compared by leaving one repeat out.

Held loads and swings of a donning are described together, F = k x + c ẋ + m ẍ + Σ g z, where z is the extension's
response to the measured history. Every class has what the default estimate has: in each record a zero, a drift and a
lag of its own, the lag within its prior. All is linear but one parameter of each extension, from a grid:

    stiffening   z = y², y³, y being x from where the straight line has no force        (softening where it bends down)
    friction     z = x cut to ± r where it turns (stop operator), driven through a play that noise does not cross
    SLS          ż = ẋ − z/T, T up to 1 s              creep     the same with T of 3 s and more
    slip         z = −max(0, highest force so far − a limit), counted through the donning or in each record anew

Each fold leaves one repeat out; coefficients and grid come from the others, and the force left over in it counts. A
richer class is taken only if it lowers the mean square by more than 5 % on average and raises it by more than 1 % in no
fold: information criteria believe every richer class, as the residuals of a record are not independent. A second
extension may follow, for another 15 %. Slip happens in one repeat and not again: it is decided by leaving stretches of
all records out, and then taken off.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import product

import numpy as np
from numpy.typing import NDArray
from scipy.signal import lfilter

from fitting.laws.history import History

KELVIN_VOIGT = "Kelvin-Voigt"
GAIN, SECOND_GAIN, NO_LOSS = 0.05, 0.15, 0.01
"""By which the mean square must fall for one extension, for another on top of it, and may rise in a single fold."""
MOST_EXTENSIONS = 2
FAST, SLOW = (0.03, 0.06, 0.12, 0.25, 0.5, 1.0), (3.0, 6.0, 12.0, 25.0, 50.0)
"""Relaxation times [s] of the standard linear solid and of creep."""
YIELDS = (0.05, 0.1, 0.2, 0.4, 0.8)
"""Of the standard deviation of the displacement that counts, in the donning."""
LIMITS = tuple(np.linspace(0.05, 0.9, 18).tolist())
"""Of the way from the lowest to the highest force."""
STRETCH, STRETCHES = 4.0, 5
"""Where there is one repeat only, every fifth stretch of four seconds is left out in turn."""
SLIP, STIFFENING, SOFTENING = "slip", "stiffening", "softening"
STILL = 0.02
"""A response that moves by less than this part of its usual spread in the records at hand has no coefficient there."""
HELD_WEIGHT = 5.0
"""Of a held second against a sample of a swing: so many smoothing windows are in it."""
FORCE, X, V, RATE = range(4)


@dataclass(frozen=True)
class ClassScore:
    """One law: the rms force [N] it leaves in repeats it was not fitted to, and its gain over Kelvin-Voigt."""

    name: str
    residual_rms: float
    gain: float


@dataclass(frozen=True)
class ModelComparison:
    """ranking is best first; chosen names the extensions that pass the rule, none for Kelvin-Voigt."""

    ranking: tuple[ClassScore, ...]
    chosen: tuple[str, ...]

    @property
    def name(self) -> str:
        return " + ".join(self.chosen) or KELVIN_VOIGT

    def as_softening(self) -> ModelComparison:
        """The same for a cuff that bends the other way."""
        ranking = [replace(score, name=score.name.replace(STIFFENING, SOFTENING)) for score in self.ranking]
        return ModelComparison(tuple(ranking), tuple(SOFTENING if name == STIFFENING else name for name in self.chosen))


def compare_classes(histories: Sequence[History]) -> ModelComparison | None:
    """The classes on all records of a donning in time order; None if nothing moves, or no part can be left out."""
    histories = [each for each in histories if np.count_nonzero(each.kept) > 20]
    if not histories or max(float(np.ptp(each.force[each.kept])) for each in histories) < 1.0:
        return None
    extensions, columns = _columns(histories)
    stretches = _cut(histories, columns, by_stretch=True)
    repeats = {each.repeat for each in histories}
    parts = stretches if len(repeats) == 1 else _cut(histories, columns, by_stretch=False)
    if min(len({part.fold for part in each}) for each in (parts, stretches)) < 2:
        return None  # there is nothing to leave out
    plain = _left_out(parts, ())
    if not plain.any():
        return None  # nothing is left for another law to explain
    scores = {KELVIN_VOIGT: plain, **{each.name: _left_out(parts, (each,)) for each in extensions}}
    chosen: tuple[_Extension, ...] = ()
    slip = _established_slip(stretches, extensions)
    if slip is not None:
        chosen, parts = (slip,), _taken_off(parts, slip)
        scores[slip.name] = _left_out(parts, ())
    best, limits = scores[_name(chosen)], [GAIN, SECOND_GAIN][len(chosen) :]
    for limit in limits:
        fitted = [each for each in chosen if each is not slip]
        tried = [(each, _left_out(parts, (*fitted, each))) for each in extensions if each not in chosen]
        extension, left = min(tried, key=lambda pair: float(pair[1].sum()))
        if not _is_real(best, left, limit):
            break
        chosen, best = (*chosen, extension), left
        scores[_name(chosen)] = left
    weight = sum(part.weight for part in parts)
    ranking = [
        ClassScore(name, math.sqrt(float(left.sum()) / weight), 1 - float(left.sum() / plain.sum()))
        for name, left in scores.items()
    ]
    ranking.sort(key=lambda score: score.residual_rms)
    return ModelComparison(tuple(ranking), tuple(each.name for each in chosen))


def _name(chosen: Sequence[_Extension]) -> str:
    return " + ".join(each.name for each in chosen) or KELVIN_VOIGT


def _established_slip(stretches: Sequence[_Part], extensions: Sequence[_Extension]) -> _Extension | None:
    """Slip if it explains more than any other class when stretches of all records are left out in turn.

    A cuff that slips does so in the first repeat only, so that leaving out repeats cannot tell.
    """
    left = {each.name: _left_out(stretches, (each,)) for each in extensions}
    best = min(extensions, key=lambda each: float(left[each.name].sum()))
    is_slip = best.name == SLIP and _is_real(_left_out(stretches, ()), left[SLIP], GAIN)
    return best if is_slip else None


def _taken_off(parts: Sequence[_Part], extension: _Extension) -> list[_Part]:
    """The parts with the extension's force, as all of them tell it, taken off the force."""
    whole = np.asarray(sum(part.products for part in parts))
    row = _best(whole, (extension,))
    turn = np.eye(len(whole))
    turn[FORCE, RATE + 1 :] = row[RATE + 1 :]
    return [replace(part, products=turn @ part.products @ turn.T) for part in parts]


def _is_real(before: NDArray[np.float64], after: NDArray[np.float64], gain: float) -> bool:
    """Whether the squares left in each fold (folds,) fall enough on average, and grow in none."""
    return bool(after.sum() < (1 - gain) * before.sum() and np.all(after < (1 + NO_LOSS) * before))


@dataclass(frozen=True, eq=False)
class _Extension:
    """A class: columns (one choice each) of its responses, and whether only a positive coefficient makes sense."""

    name: str
    choices: tuple[tuple[int, ...], ...]
    is_signed: bool


@dataclass(frozen=True)
class _Part:
    """A record or a fold of it: products (columns, columns) of its samples about the record's mean, their weight."""

    fold: int
    weight: float
    products: NDArray[np.float64]


def _columns(histories: Sequence[History]) -> tuple[list[_Extension], list[NDArray[np.float64]]]:
    """The extensions, and each record's columns (n, columns): force, displacement, velocity, rate of force, responses.

    All but the force and its rate have unit spread over what counts.
    """
    columns = [[each.force, each.displacement, each.velocity, each.force_rate] for each in histories]
    extensions = []
    for name, responses in _responses(histories).items():
        choices = []
        for response in responses:
            first = len(columns[0])
            for mine, added in zip(columns, response, strict=True):
                mine.extend(added)
            choices.append(tuple(range(first, len(columns[0]))))
        extensions.append(_Extension(name, tuple(choices), name != STIFFENING))
    whole = [np.column_stack(mine) for mine in columns]
    spread = np.std(np.concatenate([mine[each.kept] for each, mine in zip(histories, whole, strict=True)]), axis=0)
    spread[[FORCE, RATE]], spread[spread == 0] = 1.0, 1.0
    return extensions, [mine / spread for mine in whole]


def _cut(histories: Sequence[History], columns: Sequence[NDArray[np.float64]], by_stretch: bool) -> list[_Part]:
    """The records in folds: their repeats, or every fifth stretch of four seconds."""
    parts = []
    for history, mine in zip(histories, columns, strict=True):
        time, rows = history.time[history.kept], mine[history.kept]
        if history.is_held:
            time, rows = _whole_seconds(time, rows)
        weight = HELD_WEIGHT if history.is_held else 1.0
        freed = _freed(time, rows, history)
        folds = (time // STRETCH).astype(np.intp) % STRETCHES if by_stretch else np.full(len(rows), history.repeat)
        for fold in np.unique(folds):
            piece = freed[folds == fold]
            parts.append(_Part(int(fold), weight * len(piece), weight * piece.T @ piece))
    return parts


def _freed(time: NDArray[np.float64], rows: NDArray[np.float64], history: History) -> NDArray[np.float64]:
    """Rows (n, columns) without what the record's zero, its drift and its lag, as far as its prior lets it, explain.

    The lag τ costs (τ/lag_sd)² as a residual of one standard deviation does; that of the force is what a spring and a
    damper leave over in this record alone.
    """
    zero = np.vander(time - time.mean(), 2 if history.drifts else 1)
    rows = rows - zero @ np.linalg.lstsq(zero, rows, rcond=None)[0]
    rate = rows[:, RATE].copy()
    power = float(rate @ rate)
    if history.lag_sd == 0 or power == 0:
        return rows
    law = rows[:, [X, V, RATE]]
    left = rows[:, FORCE] - law @ np.linalg.lstsq(law, rows[:, FORCE], rcond=None)[0]
    held_back = float(left @ left) / len(left) / history.lag_sd**2
    # Squares of what is left are least over τ: 1 − share of the part along the rate stays, its root in a row.
    share = power / (power + held_back)
    return np.asarray(rows - (1 - math.sqrt(1 - share)) * np.outer(rate, rate @ rows) / power)


def _whole_seconds(
    time: NDArray[np.float64], rows: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Means over the seconds in which most samples count. Noise of a still cuff would pass for small motions."""
    second, index, count = np.unique(np.floor(time), return_inverse=True, return_counts=True)
    total = np.zeros((len(second), rows.shape[1]))
    np.add.at(total, index, rows)
    is_whole = count > 0.5 * count.max()
    return second[is_whole], total[is_whole] / count[is_whole, None]


def _left_out(parts: Sequence[_Part], extensions: Sequence[_Extension]) -> NDArray[np.float64]:
    """Squares left in each fold (folds,) [N²] by the law that fits the others best."""
    left = []
    for fold in sorted({part.fold for part in parts}):
        inside = sum(part.products for part in parts if part.fold == fold)
        row = _best(np.asarray(sum(part.products for part in parts if part.fold != fold)), extensions)
        left.append(max(0.0, float(row @ inside @ row)))  # what is nothing comes out as ± the rounding
    return np.array(left)


def _best(products: NDArray[np.float64], extensions: Sequence[_Extension]) -> NDArray[np.float64]:
    """The row that takes columns to what is left of the force, of the choices that leave least and make sense."""
    rows = [_fit(products, extensions, chosen) for chosen in product(*(each.choices for each in extensions))]
    sensible = [row for row in rows if row is not None]
    if not sensible:
        return _best(products, extensions[:-1])
    return min(sensible, key=lambda row: float(row @ products @ row))


def _fit(
    products: NDArray[np.float64], extensions: Sequence[_Extension], chosen: Sequence[tuple[int, ...]]
) -> NDArray[np.float64] | None:
    """1 for the force, minus coefficients elsewhere; None where a coefficient has a sign without a meaning."""
    used = [X, V, *(column for columns in chosen for column in columns)]
    scale = np.sqrt(np.diag(products)[used])
    scale[scale < STILL * scale[0]] = np.inf
    normal = products[np.ix_(used, used)] / np.outer(scale, scale)
    solved = np.linalg.lstsq(normal, products[used, FORCE] / scale, rcond=1e-9)[0] / scale
    row = np.zeros(len(products))
    row[FORCE], row[used] = 1.0, -solved
    signed = [column for each, columns in zip(extensions, chosen, strict=True) if each.is_signed for column in columns]
    return None if np.any(row[signed] > 0) else row


def _responses(histories: Sequence[History]) -> Mapping[str, list[list[list[NDArray[np.float64]]]]]:
    """Extension → choice of its parameter → record → columns (n,)."""
    spread = float(np.std(np.concatenate([each.displacement[each.kept] for each in histories])))
    return {
        STIFFENING: [[_powers(each, _stiffness(histories)) for each in histories]],
        "friction": [[[_stop(each, part * spread)] for each in histories] for part in YIELDS],
        "standard linear solid": [[[_relaxing(each, time)] for each in histories] for time in FAST],
        "creep": [[[_relaxing(each, time)] for each in histories] for time in SLOW],
        SLIP: [[[column] for column in columns] for columns in _slips(histories)],
    }


def _stiffness(histories: Sequence[History]) -> float:
    force, x = (
        np.concatenate([values[each.kept] - values[each.kept].mean() for each, values in pairs])
        for pairs in ([(e, e.force) for e in histories], [(e, e.displacement) for e in histories])
    )
    return float(force @ x / (x @ x))


def _powers(history: History, stiffness: float) -> list[NDArray[np.float64]]:
    x, force = history.displacement, history.force
    y = x - x[history.kept].mean() + force[history.kept].mean() / stiffness
    return [y**2, y**3]


def _stop(history: History, reach: float) -> NDArray[np.float64]:
    """The way since the last turn, at most ± reach, of what is left of the displacement by a play."""
    played, z = history.displacement[0], 0.0
    found = np.empty(len(history.time))
    for i, x in enumerate(history.displacement.tolist()):
        moved = max(x - history.play, min(played, x + history.play)) - played
        played += moved
        z = max(-reach, min(z + moved, reach))
        found[i] = z
    return found


def _relaxing(history: History, time: float) -> NDArray[np.float64]:
    """z with ż = ẋ − z/T, at rest in the beginning."""
    step = history.time[1] - history.time[0]
    stays = math.exp(-step / time)
    moved = np.diff(history.displacement, prepend=history.displacement[0])
    return np.asarray(lfilter([time / step * (1 - stays)], [1, -stays], moved))


def _slips(histories: Sequence[History]) -> Iterator[list[NDArray[np.float64]]]:
    """−how far the highest force so far exceeds each limit: of all records before as well, or of this one only."""
    runs = [np.maximum.accumulate(each.force) for each in histories]
    before = np.concatenate(([-np.inf], np.maximum.accumulate([run[-1] for run in runs])[:-1]))
    low, high = min(float(run[0]) for run in runs), max(float(run[-1]) for run in runs)
    for part in LIMITS:
        limit = low + part * (high - low)
        for highest in ([np.maximum(run, b) for run, b in zip(runs, before, strict=True)], runs):
            yield [-np.maximum(0.0, each - limit) for each in highest]
