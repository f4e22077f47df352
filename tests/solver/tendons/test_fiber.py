"""Elastic tendons: the balance of forces written out with the vector curves, derivatives, and refusals."""

from dataclasses import replace

import numpy as np
import pytest

from solver.bundled import bundled_model
from solver.errors import SolverCode
from solver.functions.muscle_curves import (
    Curves,
    DeGrooteFreglyCurves,
    DeGrooteFreglyTendon,
    MillardCurves,
    MillardTendon,
    SchutteCurves,
    TendonCurve,
    ThelenCurves,
    ThelenTendon,
)
from solver.model import Array, Model
from solver.muscle import muscle_forces
from solver.tendons.fiber import (
    StepStart,
    allocate_settled,
    elastic_forces,
    elastic_muscles,
    fiber_tables,
    fill_settled,
)
from tests.refusals import raises_refusal

BUNDLED = bundled_model()
INTERVAL = 0.01
KINDS: dict[str, tuple[Curves, TendonCurve, float]] = {
    "millard": (MillardCurves(minimum=0.0), MillardTendon(), 0.1),
    "thelen": (ThelenCurves(), ThelenTendon(), 0.0),
    "de_groote": (DeGrooteFreglyCurves(width=1.2), DeGrooteFreglyTendon(0.06), 0.02),
}


def model_of(kind: str) -> Model:
    """The bundled muscles with these curves and some pennation; rigid tendons stay so."""
    curves, tendon, damping = KINDS[kind]
    muscles = tuple(
        replace(
            muscle,
            curves=curves,
            tendon=muscle.tendon and tendon,
            fiber_damping=damping,
            pennation_at_optimal=0.02 * index,
        )
        for index, muscle in enumerate(BUNDLED.muscles)
    )
    return replace(BUNDLED, muscles=muscles)


def course(model: Model, frames: int = 61) -> tuple[Array, Array, Array]:
    """Path lengths [m], speeds and activations (frames, muscles), a swing about the optimal length."""
    time = np.arange(frames)[:, None] * INTERVAL
    optimal, slack = (
        np.array([getattr(muscle, name) for muscle in model.muscles])
        for name in ("optimal_fiber_length", "tendon_slack_length")
    )
    lengths = slack + optimal * (1.0 + 0.2 * np.sin(12.0 * time))
    return lengths, optimal * 2.4 * np.cos(12.0 * time), np.broadcast_to(0.5 - 0.3 * np.cos(9.0 * time), lengths.shape)


def column(model: Model, name: str) -> Array:
    return np.array([getattr(muscle, name) for muscle in model.muscles])[elastic_muscles(model)]


@pytest.mark.parametrize("kind", KINDS)
def test_fibre_and_tendon_pull_alike_in_every_frame(kind: str) -> None:
    model = model_of(kind)
    lengths, speeds, activations = course(model)
    found, chosen = elastic_forces(model, lengths, speeds, activations, INTERVAL), elastic_muscles(model)
    curves, tendon, damping = KINDS[kind]
    optimal, strength = column(model, "optimal_fiber_length"), column(model, "max_isometric_force")
    fiber = found.fiber_lengths[:, chosen] / optimal
    cos = np.sqrt(1.0 - (np.sin(column(model, "pennation_at_optimal")) / fiber) ** 2)
    rates = np.empty_like(fiber)  # of the normalised length, as the step's formulas have it
    rates[0] = speeds[0, chosen] * cos[0] / optimal
    rates[1] = (fiber[1] - fiber[0]) / INTERVAL
    rates[2:] = (3 * fiber[2:] - 4 * fiber[1:-1] + fiber[:-2]) / (2 * INTERVAL)
    v, a = rates / column(model, "max_contraction_velocity"), activations[:, chosen]
    pace = 0.25 + 0.75 * a if kind == "thelen" else 1.0
    active = a * curves.active_force_length(fiber) * curves.force_velocity(v / pace)
    pulled = (active + curves.passive_force_length(fiber) + damping * v) * cos
    stretched = tendon.force(1.0 + found.tendon_strain[:, chosen])
    tension = found.tension[:, chosen] / strength
    assert found.is_converged.all() and not found.is_shortest.any() and np.ptp(tension) > 0.5
    np.testing.assert_allclose(stretched, tension, rtol=0, atol=1e-11)
    np.testing.assert_allclose(pulled, tension, rtol=0, atol=1e-10)
    np.testing.assert_allclose(
        found.passive[:, chosen] / strength, curves.passive_force_length(fiber) * cos, rtol=0, atol=1e-11
    )
    path = fiber * cos * optimal + (1.0 + found.tendon_strain[:, chosen]) * column(model, "tendon_slack_length")
    np.testing.assert_allclose(path, lengths[:, chosen], rtol=1e-12)


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("is_first", [True, False])
def test_the_derivative_by_the_activation_is_that_of_finite_differences(kind: str, is_first: bool) -> None:
    model = model_of(kind)
    tables, random = fiber_tables(model), np.random.default_rng(3)
    count = len(tables.muscle)
    lengths, speeds, _ = course(model, 6)
    path, a, none = np.ascontiguousarray(lengths[5, tables.muscle]), random.uniform(0.2, 0.9, count), np.zeros(count)
    first = StepStart(none, none, speeds[5, tables.muscle] / tables.scales[:, 0] / 10.0, np.ones(count))
    later = StepStart(random.uniform(0.9, 1.1, count), np.full(count, 15.0), none, np.ones(count))
    settled = [allocate_settled(count) for _ in range(3)]
    for change, result in zip((0.0, 1e-5, -1e-5), settled, strict=True):
        fill_settled(tables, path, a + change, first if is_first else later, result)
    slopes = (settled[1].force - settled[2].force) / 2e-5
    np.testing.assert_allclose(settled[0].gain, slopes, rtol=1e-6, atol=1e-8)
    assert (settled[0].gain > 0.0).all()


def test_a_rigid_tendon_has_the_forces_of_a_rigid_tendon() -> None:
    lengths, speeds, activations = course(BUNDLED)
    found, rigid = (
        elastic_forces(BUNDLED, lengths, speeds, activations, INTERVAL),
        muscle_forces(BUNDLED, lengths, speeds),
    )
    is_rigid = np.array([muscle.tendon is None for muscle in BUNDLED.muscles])
    assert is_rigid.sum() == 14
    tension = rigid.active * activations + rigid.passive
    np.testing.assert_array_equal(found.tension[:, is_rigid], tension[:, is_rigid])
    assert np.isnan(found.tendon_strain[:, is_rigid]).all()
    assert np.abs(found.tension - tension)[:, ~is_rigid].max() > 1.0


def test_a_stiff_tendon_comes_near_a_rigid_one() -> None:
    """Without damping, which rigid tendons leave out."""
    lengths, speeds, activations = course(BUNDLED)
    rigid = muscle_forces(BUNDLED, lengths, speeds)
    tension, errors = rigid.active * activations + rigid.passive, []
    for strain in (0.02, 0.002):
        tendon = MillardTendon(strain, 1.375 / strain)
        muscles = tuple(replace(m, tendon=m.tendon and tendon, fiber_damping=0.0) for m in BUNDLED.muscles)
        stiff = elastic_forces(replace(BUNDLED, muscles=muscles), lengths, speeds, activations, INTERVAL)
        errors.append(np.abs(stiff.tension - tension)[3:] / [m.max_isometric_force for m in muscles])
    assert errors[1].max() < 0.02
    assert np.mean(errors[1]) < 0.3 * np.mean(errors[0])


def test_a_slack_tendon_has_no_force() -> None:
    lengths, speeds, activations = course(BUNDLED)
    short = 0.3 * column(BUNDLED, "tendon_slack_length")
    lengths[:, elastic_muscles(BUNDLED)] = short
    found = elastic_forces(BUNDLED, lengths, 0.0 * speeds, activations, INTERVAL)
    assert not found.tension[:, elastic_muscles(BUNDLED)].any()
    assert found.is_converged.all()


@pytest.mark.parametrize("kind", KINDS)
def test_a_resting_fibre_is_held_by_damping_or_by_the_least_activation(kind: str) -> None:
    """A fibre without either would be as short as it can be, because nothing balances its tendon."""
    model = model_of(kind)
    lengths, speeds, activations = course(model)
    found = [
        elastic_forces(model, lengths, speeds, np.full_like(activations, a), INTERVAL).fiber_lengths
        for a in (0.0, 0.01)
    ]
    chosen = elastic_muscles(model)
    is_same = np.array_equal(found[0][:, chosen], found[1][:, chosen])
    assert np.isfinite(found[0][:, chosen]).all()
    assert is_same == (kind == "thelen")


def test_a_model_without_elastic_tendons_is_refused() -> None:
    lengths = np.full((2, 33), 0.2)
    rigid = replace(BUNDLED, muscles=tuple(replace(muscle, tendon=None) for muscle in BUNDLED.muscles))
    with raises_refusal(SolverCode.NO_TENDON, naming=BUNDLED.name):
        elastic_forces(rigid, lengths, 0 * lengths, lengths, INTERVAL)
    first = replace(BUNDLED.muscles[0], curves=SchutteCurves(), tendon=None)
    with raises_refusal(SolverCode.NO_TENDON, naming=first.name):
        elastic_forces(replace(BUNDLED, muscles=(first, *BUNDLED.muscles[1:])), lengths, 0 * lengths, lengths, INTERVAL)


def test_activations_of_other_muscles_are_refused() -> None:
    lengths = np.full((2, 33), 0.2)
    with raises_refusal(SolverCode.WRONG_SHAPE, naming="33"):
        elastic_forces(BUNDLED, lengths, lengths, lengths[:, :32], INTERVAL)
