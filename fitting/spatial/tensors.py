"""Fit stiffness and damping of one donning in three dimensions, from pulls along several lines.

Stiffness from held loads: X = K⁻¹ F u + X0, an offset X0 per segment of a trial. F is the force of the load cell, u the
direction of the rope and X the displacement of the cuff in the anchor's frame. Compliance is fitted, because
displacement has most of the noise; errors of F and u are included in the weights.

Damping from swings: the measured force vector drives m Ẍ + C Ẋ + K X = F u. Output error, as in cross_checks.py: the
simulated displacement is fitted to the markers, so marker noise causes no bias. The law is solved in the frequency
domain, X(ω) = (K + iωC − ω²m)⁻¹ (F u)(ω). The start is a fit of X = A F u + B d(F u)/dt, linear in symmetric A and B. K
of the swings is fitted with C, because it may differ from that of the held loads.

Pulls along one direction determine three of the six entries, pulls in a plane five. So at least three directions that
span space are needed. The numerical rank does not show this, because sway rotates the rope slightly.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
import scipy
from numpy.typing import NDArray

from documents.message import Figures, because
from documents.results import EqualByFields
from fitting.errors import CodedError, UnusableTrial
from fitting.pull.plateaus import SAME_LOAD, Plateau
from fitting.pull.pull import APART, Pull, angle_between, of_test
from fitting.results.codes import NEGLIGIBLE, FitOutcome
from fitting.results.sentences import Note
from fitting.results.trial_codes import TensorCode
from fitting.trial.bounce import Oscillation, find_oscillation
from fitting.uncertainty import NORMAL_95, Estimate, chi_square_limit, student_half_width

LEAST_SPREAD = 0.15
"""Least third singular value of the unit vectors, over the first, for directions that span space."""
ENTRIES = ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))
"""The order of the six entries in a covariance."""


class NoTensor(CodedError):
    """The trials determine no tensor; outcome is that of an iteration that failed."""

    def __init__(self, code: TensorCode, figures: Figures | None = None, outcome: FitOutcome | None = None) -> None:
        super().__init__(code, figures)
        self.outcome = outcome


@dataclass(frozen=True, eq=False)
class Tensor(EqualByFields):
    """A symmetric tensor [N/m or N s/m] in the reference posture's frame of the donning.

    value       (3, 3)
    covariance  (6, 6) of ENTRIES
    factor      half width of a 95 % interval over the standard error
    directions  number of different directions of the pulls
    parts       covariances (6, 6) by cause ("noise", "lag", "gain", "posture") that add up to the whole
    """

    value: NDArray[np.float64]
    covariance: NDArray[np.float64]
    factor: float
    directions: int
    parts: Mapping[str, NDArray[np.float64]] = field(default_factory=dict)

    @property
    def standard_error(self) -> NDArray[np.float64]:
        """(3, 3) of the entries."""
        return entry_errors(self.covariance)

    @property
    def ci95(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Lower and upper ends (3, 3) of the entries' 95 % intervals."""
        half = self.factor * self.standard_error
        return self.value - half, self.value + half

    @property
    def eigenvalues(self) -> tuple[Estimate, ...]:
        """The three eigenvalues, smallest first, with errors to first order."""
        values, axes = np.linalg.eigh(self.value)
        found = []
        for value, axis in zip(values, axes.T, strict=True):
            slope = tensor_entries(np.outer(axis, axis)) * _TWICE
            error = math.sqrt(float(slope @ self.covariance @ slope))
            half = self.factor * error
            found.append(Estimate(float(value), error, (float(value) - half, float(value) + half)))
        return tuple(found)

    @property
    def axes(self) -> NDArray[np.float64]:
        """Unit vectors (3, 3) as rows, in the order of the eigenvalues; the largest component is positive."""
        rows = np.linalg.eigh(self.value)[1].T
        signs = np.sign(rows[np.arange(3), np.argmax(np.abs(rows), axis=1)])
        return np.asarray(rows * signs[:, None])

    @property
    def axis_ci95(self) -> tuple[float, ...]:
        """Half angle [rad] of the 95 % cone of every axis; π/2 if its eigenvalue is not distinct."""
        values, axes = np.linalg.eigh(self.value)
        cones = []
        for i in range(3):
            others = [j for j in range(3) if j != i]
            pairs = [np.outer(axes[:, j], axes[:, i]) / (values[i] - values[j]) for j in others]
            slopes = np.array([tensor_entries((pair + pair.T) / 2) * _TWICE for pair in pairs])
            largest = float(np.linalg.eigvalsh(slopes @ self.covariance @ slopes.T)[-1])
            cones.append(min(math.pi / 2, self.factor / NORMAL_95 * math.sqrt(chi_square_limit(2, 0.95) * largest)))
        return tuple(cones)

    def scaled_error(self, relative: float) -> NDArray[np.float64]:
        """Covariance (6, 6) due to a relative error common to all entries."""
        return relative**2 * np.outer(tensor_entries(self.value), tensor_entries(self.value))

    def widened(self, causes: Mapping[str, NDArray[np.float64]]) -> Tensor:
        """The tensor with additional covariances (6, 6) by cause; its own covariance becomes the part "noise"."""
        parts = {"noise": self.covariance, **causes}
        return replace(self, covariance=np.sum(list(parts.values()), axis=0), parts=parts)


def symmetric(entries: NDArray[np.float64]) -> NDArray[np.float64]:
    """(3, 3) of six entries."""
    matrix = np.zeros((3, 3))
    for (i, j), entry in zip(ENTRIES, entries, strict=True):
        matrix[i, j] = matrix[j, i] = entry
    return matrix


def tensor_entries(matrix: NDArray[np.float64]) -> NDArray[np.float64]:
    """The six entries of a symmetric (3, 3)."""
    return np.array([matrix[i, j] for i, j in ENTRIES])


def unit_tensors() -> NDArray[np.float64]:
    """Basis (6, 3, 3) of symmetric tensors, in the order of ENTRIES."""
    return np.array([symmetric(row) for row in np.eye(6)])


def require_span(directions: NDArray[np.float64], quantity: str, test: str) -> int:
    """Number of different directions among unit vectors (n, 3). Raises NoTensor unless they span space."""
    kinds = _different_directions(directions)
    _, singular, rows = np.linalg.svd(kinds)
    spans = int(np.count_nonzero(singular > LEAST_SPREAD * singular[0]))
    if spans == 3:
        return len(kinds)
    missing = " and ".join("(" + ", ".join(f"{part:.2f}" for part in row) + ")" for row in rows[spans:])
    code = {1: TensorCode.ONE_LINE, 2: TensorCode.ONE_PLANE}[spans]
    raise NoTensor(code, {"quantity": quantity, "test": test, "directions": len(kinds), "missing": missing})


def _require_positive(tensor: Tensor) -> Tensor:
    """A tensor of stiffness. Raises NoTensor if the interval of an eigenvalue includes values below 0."""
    lowest = tensor.eigenvalues[0]
    if lowest.ci95[0] <= 0:
        half_width = tensor.factor * lowest.standard_error
        figures: Figures = {"quantity": "stiffness", "eigenvalue": lowest.value, "half_width": half_width}
        raise NoTensor(TensorCode.NOT_POSITIVE, figures)
    return tensor


def entry_errors(covariance: NDArray[np.float64]) -> NDArray[np.float64]:
    """Standard errors (3, 3) of entries with a covariance (6, 6)."""
    return symmetric(np.sqrt(np.diag(covariance)))


_TWICE = np.array([1.0, 1.0, 1.0, 2.0, 2.0, 2.0])


def _different_directions(directions: NDArray[np.float64]) -> NDArray[np.float64]:
    """Different directions (kinds, 3): those within APART of the line of a previous one are left out."""
    kinds: list[NDArray[np.float64]] = []
    for direction in directions:
        if not any(angle_between(direction, kind) < APART for kind in kinds):
            kinds.append(direction)
    return np.array(kinds)


def half_width_factor(inflation: float, dof: int) -> float:
    """Half width of a 95 % interval over the standard error: Student's t if the error is from the scatter."""
    return student_half_width(dof) if inflation > 1 else NORMAL_95


def posture_error(tensor: NDArray[np.float64], anchor: NDArray[np.float64], anchor_rms: float) -> NDArray[np.float64]:
    """Covariance (6, 6) of a tensor (3, 3) due to noise of the reference posture, which rotates the tensor.

    anchor (markers, 3) [m] are the marker positions, NaN if not seen. anchor_rms [m] is the residual of the rigid fit,
    which has six degrees of freedom.

    A small rotation θ adds θ× T − T θ×. Its covariance is s² (Σ |r|² − r rᵀ)⁻¹ for anchor markers at r from their
    centre, with noise s of the single frame to which the others are aligned.
    """
    positions = anchor[np.isfinite(anchor).all(axis=1)]
    positions = positions - positions.mean(axis=0)
    count = len(positions)
    noise = anchor_rms**2 * 3 * count / max(3 * count - 6, 1) / 3
    inertia = np.sum(positions**2) * np.eye(3) - positions.T @ positions
    turns = [np.cross(np.eye(3), axis) for axis in -np.eye(3)]
    slopes = np.array([tensor_entries(turn @ tensor - tensor @ turn) for turn in turns]).T
    return np.asarray(slopes @ np.linalg.inv(inertia) @ slopes.T * noise)


BATCH = 0.5
"""Seconds of the batch means from which the error of a hold's mean is computed, because sway is coloured noise."""
HELD_ROUNDS, MOST_HELD_ROUNDS = 6, 40
"""Least and largest number of reweighting rounds; they end when the compliance has converged."""
SETTLING = 0.5
"""Seconds at both ends that are simulated but not compared."""
HIGHEST = 10.0
"""Cut-off frequency [Hz] of the low-pass filter of the force, below the Nyquist frequency of the markers."""
OUTLIER = 5.0
SWUNG_ROUNDS = 40
STEP_TOLERANCE = 0.03
"""Largest last step in standard errors."""


@dataclass(frozen=True)
class Tensors:
    """K and C of one donning in three dimensions; None with the reason in no_stiffness and no_damping."""

    stiffness: Tensor | None
    damping: Tensor | None
    no_stiffness: Note | None = None
    no_damping: Note | None = None


def fit_tensors(pulls: Sequence[Pull], swings: Mapping[str, Oscillation]) -> Tensors:
    """K from the static pulls and C from the dynamic ones; swings by file, if they are known."""
    gain_sd = max((pull.trial.gain_sd for pull in pulls), default=0.0)
    stiffness, no_stiffness = _or_reason(lambda: held_tensor(of_test(pulls, "static"), gain_sd))
    damping, no_damping = _or_reason(lambda: swung_tensor(of_test(pulls, "dynamic"), swings, gain_sd))
    return Tensors(stiffness, damping, no_stiffness, no_damping)


def _or_reason(fit: Callable[[], Tensor]) -> tuple[Tensor | None, Note | None]:
    try:
        return fit(), None
    except NoTensor as error:
        return None, error.reason


def held_tensor(trials: Sequence[Pull], gain_sd: float) -> Tensor:
    """K (3, 3) [N/m] of the static trials of one donning; gain_sd is relative. Raises NoTensor."""
    seen = [(pull, rope) for pull in trials if (rope := pull.motion.rope) is not None and len(pull.plateaus) > 1]
    if not seen:
        raise NoTensor(TensorCode.NO_ROPE, {"quantity": "stiffness", "test": "static"})
    directions = require_span(np.array([pull.direction for pull, _ in seen]), "stiffness", "static")
    holds = [[_hold(pull, rope, plateau) for plateau in pull.plateaus] for pull, rope in seen]
    fit = _solve(holds, [np.zeros(len(trial), np.intp) for trial in holds])
    if fit.chi_square > chi_square_limit(max(fit.dof, 1)):
        slipped = [_segments(pull.plateaus) for pull, _ in seen]
        if all(len(np.unique(segment)) < len(segment) for segment in slipped):
            fit = _solve(holds, slipped)
    if fit.outcome is not FitOutcome.CONVERGED:
        raise NoTensor(TensorCode.NOT_CONVERGED, {"quantity": "stiffness"}, fit.outcome)
    inflation = fit.chi_square / fit.dof if fit.dof else 1.0
    # δK = −K δ(K⁻¹) K for every entry.
    stiffness = np.asarray(np.linalg.inv(fit.compliance), dtype=np.float64)
    turn = np.array([tensor_entries(-stiffness @ unit @ stiffness) for unit in unit_tensors()]).T
    covariance = max(1.0, inflation) * turn @ fit.covariance @ turn.T
    tensor = Tensor(stiffness, covariance, half_width_factor(inflation, max(fit.dof, 1)), directions)
    posture = posture_error(stiffness, seen[0][0].motion.anchor, seen[0][0].markers.anchor_rms)
    return _require_positive(tensor.widened({"gain": tensor.scaled_error(gain_sd), "posture": posture}))


@dataclass(frozen=True)
class _Hold:
    """One held load: force [N] along u (3,), displacement (3,) [m], and their standard errors."""

    force: float
    force_sd: float
    u: NDArray[np.float64]
    u_sd: float
    x: NDArray[np.float64]
    x_sd: float


@dataclass(frozen=True)
class _Fit:
    compliance: NDArray[np.float64]
    covariance: NDArray[np.float64]
    chi_square: float
    dof: int
    outcome: FitOutcome


def _hold(pull: Pull, rope: NDArray[np.float64], plateau: Plateau) -> _Hold:
    trial, motion = pull.trial, pull.motion
    inside = (trial.marker_time >= plateau.start) & (trial.marker_time <= plateau.end)
    time = trial.marker_time[inside]
    x, x_sd = _mean(time, motion.displacement[inside])
    mean, u_sd = _mean(time, rope[inside])
    u = mean / np.linalg.norm(mean)
    return _Hold(plateau.force, plateau.force_sd, u * np.sign(u @ pull.direction), u_sd, x, x_sd)


def _mean(time: NDArray[np.float64], values: NDArray[np.float64]) -> tuple[NDArray[np.float64], float]:
    """Mean (3,) of the visible values (frames, 3), and its error per axis from the means of half seconds."""
    seen = np.isfinite(values).all(axis=1)
    if np.count_nonzero(seen) < 2:
        raise NoTensor(TensorCode.ROPE_HIDDEN_IN_HOLD)
    time, values = time[seen], values[seen]
    white = _rms(np.std(values, axis=0, ddof=1)) / math.sqrt(len(values))
    batch = ((time - time[0]) / BATCH).astype(np.intp)
    count = np.bincount(batch)
    full = count > 0.5 * count.max()
    means = np.array([np.bincount(batch, column)[full] / count[full] for column in values.T])
    batched = _rms(np.std(means, axis=1, ddof=1)) / math.sqrt(full.sum()) if full.sum() >= 4 else 0.0
    return values.mean(axis=0), max(white, batched)


def _rms(values: NDArray[np.float64]) -> float:
    return math.sqrt(float(np.mean(values**2)))


def _segments(plateaus: Sequence[Plateau]) -> NDArray[np.intp]:
    """Segment numbers (plateaus,) if the cuff slips whenever the load exceeds all previous loads of the trial."""
    force = np.array([plateau.force for plateau in plateaus])
    highest = np.maximum.accumulate(force)
    begins = np.concatenate(([False], force[1:] > highest[:-1] + SAME_LOAD))
    return np.cumsum(begins, dtype=np.intp)


def _solve(holds: Sequence[Sequence[_Hold]], segments: Sequence[NDArray[np.intp]]) -> _Fit:
    """Weighted least squares of the six compliances and the offsets, with weights of the previous round."""
    flat = [hold for trial in holds for hold in trial]
    units = unit_tensors()
    design = np.concatenate([(units @ (hold.force * hold.u)).T for hold in flat])
    offsets = scipy.linalg.block_diag(*(np.kron(np.eye(segment.max() + 1)[segment], np.eye(3)) for segment in segments))
    columns = np.hstack((design, offsets))
    x = np.concatenate([hold.x for hold in flat])
    compliance, outcome = np.zeros((3, 3)), FitOutcome.NOT_CONVERGED
    for count in range(1, MOST_HELD_ROUNDS + 1):
        roots = scipy.linalg.block_diag(*(_whitening(hold, compliance) for hold in flat))
        white = roots @ np.column_stack((columns, x))
        scale = np.linalg.norm(white[:, :-1], axis=0)
        solved, _, rank, _ = np.linalg.lstsq(white[:, :-1] / scale, white[:, -1])
        if rank < len(scale):
            raise NoTensor(TensorCode.EQUAL_LOADS)
        before, compliance = compliance, symmetric(solved[:6] / scale[:6])
        inverse = np.linalg.inv((white[:, :-1] / scale).T @ (white[:, :-1] / scale)) / np.outer(scale, scale)
        change = tensor_entries(compliance - before)
        if count >= HELD_ROUNDS and np.all(change**2 <= NEGLIGIBLE**2 * np.diag(inverse)[:6]):
            outcome = FitOutcome.CONVERGED
            break
    residual = white[:, -1] - white[:, :-1] @ (solved / scale)
    return _Fit(compliance, inverse[:6, :6], float(residual @ residual), len(x) - len(scale), outcome)


def _whitening(hold: _Hold, compliance: NDArray[np.float64]) -> NDArray[np.float64]:
    """Whitening matrix (3, 3) of the displacement of a hold, with the errors of force and direction included."""
    along = np.outer(hold.u, hold.u)
    force = hold.force_sd**2 * along + (hold.force * hold.u_sd) ** 2 * (np.eye(3) - along)
    variance = hold.x_sd**2 * np.eye(3) + compliance @ force @ compliance
    return np.asarray(np.linalg.inv(np.linalg.cholesky(variance)), dtype=np.float64)


def swung_tensor(trials: Sequence[Pull], swings: Mapping[str, Oscillation], gain_sd: float) -> Tensor:
    """C (3, 3) [N s/m] of the dynamic trials of one donning; swings by file, if known. Raises NoTensor."""
    seen = [(pull, rope) for pull in trials if (rope := pull.motion.rope) is not None]
    if not seen:
        raise NoTensor(TensorCode.NO_ROPE, {"quantity": "damping", "test": "dynamic"})
    directions = require_span(np.array([pull.direction for pull, _ in seen]), "damping", "dynamic")
    cut = [_cut(pull, rope, swings.get(pull.trial.file)) for pull, rope in seen]
    parameters = _start(cut)
    for _ in range(SWUNG_ROUNDS):
        change, covariance = _step(cut, parameters)
        parameters = parameters + change
        if np.all(np.abs(change) < STEP_TOLERANCE * np.sqrt(np.diag(covariance))):
            break
    else:
        raise NoTensor(TensorCode.NOT_CONVERGED, {"quantity": "damping"}, FitOutcome.NOT_CONVERGED)
    stiffness, damping = parameters[:6], parameters[6:]
    # To first order a lag τ adds K τ to C, equally in all trials.
    lag = max(swing.lag_sd for swing in cut)
    tensor = Tensor(symmetric(damping), covariance[6:, 6:], NORMAL_95, directions)
    posture = posture_error(tensor.value, seen[0][0].motion.anchor, seen[0][0].markers.anchor_rms)
    return tensor.widened(
        {"lag": lag**2 * np.outer(stiffness, stiffness), "gain": tensor.scaled_error(gain_sd), "posture": posture}
    )


@dataclass(frozen=True)
class _Swing:
    """One swing on the regular grid of frames: force vector (n, 3) [N], displacement (n, 3) [m], compared frames."""

    step: float
    force: NDArray[np.float64]
    x: NDArray[np.float64]
    is_compared: NDArray[np.bool_]
    mass: float
    frequency: float
    lag_sd: float


def _cut(pull: Pull, rope: NDArray[np.float64], oscillation: Oscillation | None) -> _Swing:
    trial = pull.trial
    try:
        oscillation = oscillation or find_oscillation(pull.force_time, pull.force)
    except UnusableTrial as error:
        raise NoTensor(TensorCode.NO_SWING, {"file": trial.file, **because(error)}) from error
    inside = (pull.marker_time >= max(oscillation.start - SETTLING, pull.force_time[0])) & (
        pull.marker_time <= min(oscillation.end + SETTLING, pull.force_time[-1])
    )
    time = pull.marker_time[inside]
    step = float(np.median(np.diff(time)))
    rope = rope[inside] * np.sign(np.nansum(rope[inside], axis=0) @ pull.direction)
    known = np.isfinite(rope).all(axis=1)
    if np.count_nonzero(known) < len(time) / 2:
        raise NoTensor(TensorCode.ROPE_HIDDEN, {"quantity": "damping", "file": trial.file})
    u = np.column_stack([np.interp(time, time[known], column[known]) for column in rope.T])
    low_pass = scipy.signal.butter(4, min(HIGHEST, 0.4 / step), fs=1 / step, output="sos")
    force = np.asarray(
        scipy.signal.sosfiltfilt(low_pass, _force_at(pull.force_time, pull.force, time, step)[:, None] * u, axis=0)
    )
    x = pull.motion.displacement[inside]
    is_compared = np.isfinite(x).all(axis=1) & (time >= time[0] + SETTLING) & (time <= time[-1] - SETTLING)
    return _Swing(
        step, force, x, is_compared, trial.cuff_mass, oscillation.frequency, trial.lag.total(oscillation.middle)
    )


def _force_at(
    force_time: NDArray[np.float64], force: NDArray[np.float64], time: NDArray[np.float64], step: float
) -> NDArray[np.float64]:
    """Force (n,) at the frames: block means over half a frame, interpolated by a cubic spline."""
    per_block = max(1, int(step / 2 / float(np.median(np.diff(force_time)))))
    whole = len(force) // per_block * per_block
    means = (values[:whole].reshape(-1, per_block).mean(axis=1) for values in (force_time, force))
    return np.asarray(scipy.interpolate.CubicSpline(*means)(time))


def _start(swings: Sequence[_Swing]) -> NDArray[np.float64]:
    """K and C (12,) from X = A f + B ḟ: to first order in the frequency A = K⁻¹ and B = −A C A."""
    normal, right = np.zeros((12, 12)), np.zeros(12)
    for swing in swings:
        rate = np.gradient(swing.force, swing.step, axis=0)
        design = np.concatenate(
            [np.einsum("eij,nj->nie", unit_tensors(), vector) for vector in (swing.force, rate)], axis=2
        )
        both = _without_slow(
            swing, np.concatenate((design[swing.is_compared], swing.x[swing.is_compared, :, None]), axis=2)
        )
        columns, seen = both[..., :-1].reshape(-1, 12), both[..., -1].ravel()
        normal, right = normal + columns.T @ columns, right + columns.T @ seen
    scale = np.sqrt(np.diag(normal))
    solved = np.linalg.solve(normal / np.outer(scale, scale), right / scale) / scale
    stiffness = np.asarray(np.linalg.inv(symmetric(solved[:6])), dtype=np.float64)
    return np.concatenate((tensor_entries(stiffness), tensor_entries(-stiffness @ symmetric(solved[6:12]) @ stiffness)))


def _without_slow(swing: _Swing, values: NDArray[np.float64]) -> NDArray[np.float64]:
    """Values (frames, 3, columns) without the offset and linear drift of the trial along every axis."""
    u = np.linspace(-1, 1, len(swing.x))[swing.is_compared]
    slow, _ = np.linalg.qr(np.column_stack((np.ones(len(u)), u)))
    return np.asarray(values - np.tensordot(slow, np.tensordot(slow.T, values, 1), 1))


def _step(swings: Sequence[_Swing], parameters: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """One step of Gauss-Newton (12,), and the covariance (12, 12) there."""
    normal, right = np.zeros((12, 12)), np.zeros(12)
    for swing in swings:
        model, slopes = _motion(swing, parameters)
        both = np.concatenate((slopes.transpose(1, 2, 0), (swing.x - model)[..., None]), axis=2)[swing.is_compared]
        both = _without_slow(swing, both).reshape(-1, 13)
        jacobian, residual = both[:, :-1], both[:, -1]
        limit = OUTLIER * 1.4826 * float(np.median(np.abs(residual))) + 1e-12
        residual = np.clip(residual, -limit, limit)
        weight = 1 / _noise(swing, residual.reshape(-1, 3)) ** 2
        normal += weight * jacobian.T @ jacobian
        right += weight * jacobian.T @ residual
    covariance = np.asarray(np.linalg.inv(normal), dtype=np.float64)
    return covariance @ right, covariance


def _motion(swing: _Swing, parameters: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """X (n, 3) and its derivatives (12, n, 3) with respect to the entries of K and C."""
    stiffness, damping = symmetric(parameters[:6]), symmetric(parameters[6:])
    count = len(swing.force)
    omega = 2j * np.pi * np.fft.rfftfreq(count, swing.step)[:, None, None]
    receptance = np.linalg.inv(stiffness + omega * damping + omega**2 * swing.mass * np.eye(3))
    varying = swing.force - swing.force.mean(axis=0)
    spectrum = (receptance @ np.fft.rfft(varying, axis=0)[..., None])[..., 0]
    by_stiffness = [-(receptance @ (unit @ spectrum[..., None]))[..., 0] for unit in unit_tensors()]
    spectra = np.array([*by_stiffness, *(omega[..., 0] * slope for slope in by_stiffness)])
    return np.fft.irfft(spectrum, count, axis=0), np.fft.irfft(spectra, count, axis=1)


def _noise(swing: _Swing, residual: NDArray[np.float64]) -> float:
    """Standard deviation per frame and axis; the level near the swing's frequency if that is higher."""
    power = np.mean(np.abs(np.fft.rfft(residual, axis=0)) ** 2, axis=1) / len(residual)
    frequency = np.fft.rfftfreq(len(residual), swing.step)
    near = (frequency > 0.5 * swing.frequency) & (frequency < 2 * swing.frequency)
    return max(math.sqrt(max(float(np.mean(residual**2)), float(np.mean(power[near])))), 1e-9)
