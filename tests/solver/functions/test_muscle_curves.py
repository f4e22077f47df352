"""Curves and forces of muscles, and figures that no muscle can have, which OpenSim refuses, too.

Active and passive forces of taut and pennate muscles are those of OpenSim: tests/solver/test_certified.py.
"""

from dataclasses import fields, replace
from typing import Any

import numpy as np
import pytest

from solver.bundled import bundled_model
from solver.errors import SolverCode
from solver.functions.muscle_curves import Curves, DeGrooteFreglyCurves, MillardCurves, ThelenCurves, outside_of_curves
from solver.model import Model
from solver.muscle import muscle_forces
from tests.refusals import raises_refusal

CURVES, THELEN = MillardCurves(minimum=0.0), ThelenCurves()
MUSCLE = bundled_model().muscles[0]
AS_INTEGRATED = ("minimum", "concentric_slope", "eccentric_slope")  # which OpenSim replaces by 0 with a rigid tendon


def test_the_curves_go_through_the_values_of_opensim() -> None:
    lengths = np.array([0.6, 0.8, 0.95, 1.05, 1.3, 1.6])
    active = [0.45110187832558, 0.87067661327986, 0.99508542776153]
    active += [0.99644099957849, 0.68403195736869, 0.26302688371190]
    assert np.allclose(CURVES.active_force_length(lengths), active, atol=1e-13)
    speeds = np.array([-0.5, -0.1, 0.1, 0.5])
    factors = [0.15808560444170, 0.62521428431297, 1.22515383775386, 1.33113156931448]
    assert np.allclose(CURVES.force_velocity(speeds), factors, atol=2e-13)
    passive = [0.00087743874011, 0.01704483509738, 0.12611118348263, 0.46026150479121, 0.97143048832592]
    assert np.allclose(CURVES.passive_force_length(np.array([1.02, 1.1, 1.3, 1.5, 1.69])), passive, atol=1e-13)


@pytest.mark.parametrize(
    ("curve", "ends", "values", "slopes"),
    [
        (CURVES.active_force_length, (0.4441, 1.8123), (0.0, 0.0), (0.0, 0.0)),
        (CURVES.force_velocity, (-1.0, 1.0), (0.0, 1.4), (0.0, 0.0)),
        (CURVES.passive_force_length, (1.0, 1.7), (0.0, 1.0), (0.0, 20.0 / 7.0)),
    ],
)
def test_beyond_its_ends_a_curve_is_straight(curve, ends, values, slopes) -> None:  # type: ignore[no-untyped-def]
    for end, value, slope, outward in zip(ends, values, slopes, (-0.3, 0.3), strict=True):
        assert np.allclose(curve(np.array([end, end + outward])), [value, value + slope * outward], atol=1e-14)


def test_a_curve_has_no_jump_where_its_corners_meet() -> None:
    x = np.linspace(-1.1, 2.0, 200_001)
    for curve in (CURVES.active_force_length, CURVES.force_velocity, CURVES.passive_force_length):
        assert np.abs(np.diff(curve(x))).max() < 5.01 * (x[1] - x[0])


def test_a_curve_has_the_figures_it_was_given() -> None:
    curves = MillardCurves(shortest=0.4, longest=1.9, minimum=0.05, strongest=1.6, passive_start=0.1, passive_end=0.5)
    assert np.allclose(curves.active_force_length(np.array([0.4, 1.0, 1.9, 2.5])), [0.05, 1.0, 0.05, 0.05])
    assert np.allclose(curves.force_velocity(np.array([-1.0, 0.0, 1.0])), [0.0, 1.0, 1.6])
    assert np.allclose(curves.passive_force_length(np.array([0.9, 1.1, 1.5])), [0.0, 0.0, 1.0])


def test_a_curve_without_a_bend_is_a_straight_line() -> None:
    straight = replace(CURVES, near_concentric_slope=1.0, isometric_slope=1.0, concentric_slope=1.0)
    speeds = np.linspace(-1.0, 0.0, 30)
    assert np.allclose(straight.force_velocity(speeds), 1.0 + speeds, atol=1e-14)


def test_thelens_force_at_speed_is_the_inverse_of_his_speed_at_force() -> None:
    a, strongest = THELEN.velocity_shape, THELEN.strongest
    force = np.linspace(0.0, 0.95 * strongest, 60)
    b = np.where(force <= 1.0, 1.0 + force / a, (2.0 + 2.0 / a) * (strongest - force) / (strongest - 1.0))
    assert np.allclose(THELEN.force_velocity((force - 1.0) / b), force, atol=1e-12)


def test_thelens_force_is_straight_beyond_its_end_and_never_negative() -> None:
    x = np.linspace(-2.0, 3.0, 200_001)
    force = THELEN.force_velocity(x)
    assert force.min() == 0.0
    assert np.all(force[x < -1.0] == 0.0)
    assert np.abs(np.diff(force)).max() < 12.0 * (x[1] - x[0])
    assert np.allclose(np.diff(force[x > 2.0], 2), 0.0, atol=1e-12)


def test_thelens_passive_force_is_one_at_its_strain() -> None:
    assert np.allclose(THELEN.passive_force_length(np.array([0.7, 1.0, 1.6])), [0.0, 0.0, 1.0])
    assert THELEN.active_force_length(np.array([1.0])) == 1.0


def test_a_length_that_is_not_a_number_has_no_force() -> None:
    assert np.isnan(CURVES.active_force_length(np.array([np.nan, np.nan]))).all()


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("activation_time_constant", -0.01),
        ("deactivation_time_constant", -0.04),
        ("deactivation_time_constant", np.nan),
        ("optimal_fiber_length", 0.0),
        ("tendon_slack_length", -0.1),
        ("max_contraction_velocity", -10.0),
        ("max_isometric_force", -1.0),
        ("fiber_damping", -0.1),
    ],
)
def test_an_impossible_figure_of_a_muscle_is_refused(name: str, value: float) -> None:
    with raises_refusal(SolverCode.WRONG_MUSCLE, naming=f"muscle {MUSCLE.name} should have {name}"):
        replace(MUSCLE, **{name: value})


@pytest.mark.parametrize("value", [0.0, 0.04, np.inf])
def test_an_activation_that_takes_any_value_or_never_falls_is_possible(value: float) -> None:
    assert replace(MUSCLE, deactivation_time_constant=value).deactivation_time_constant == value


@pytest.mark.parametrize(
    ("curves", "name"),
    [
        (MillardCurves(strongest=0.9), "strongest"),
        (MillardCurves(isometric_slope=0.5), "isometric_slope"),
        (MillardCurves(strongest=5.6), "isometric_slope"),
        (MillardCurves(passive_slope=0.5), "passive_slope"),
        (MillardCurves(shortest=0.8), "shortest"),
        (ThelenCurves(velocity_shape=-0.25), "velocity_shape"),
        (ThelenCurves(linear_beyond=0.5), "linear_beyond"),
        (ThelenCurves(linear_beyond=1.0), "linear_beyond"),
        (DeGrooteFreglyCurves(width=0.9), "width"),
    ],
)
def test_an_impossible_figure_of_a_curve_is_refused(curves: Curves, name: str) -> None:
    with raises_refusal(SolverCode.WRONG_MUSCLE, naming=f"muscle {MUSCLE.name} should have {name}"):
        replace(MUSCLE, curves=curves)


@pytest.mark.oracle
def test_opensim_builds_the_same_curves() -> None:
    """Of one or two figures of the defaults, each scaled by a random factor, or set where the default is 0."""
    opensim: Any = pytest.importorskip("opensim", reason="needs OpenSim: install the extra oracle")
    opensim.Logger.setLevelString("off")
    usual, generator, refused = MillardCurves(minimum=0.0), np.random.default_rng(1), 0
    names = [name for name in (field.name for field in fields(usual)) if name not in AS_INTEGRATED]
    factors = [-0.5, 0.0, 0.18, 0.22, 0.3, 0.7, 0.95, 1.05, 1.3, 2.0, 4.0, 6.0]
    for _ in range(600):
        changed = {}
        for name in generator.choice(names, generator.integers(1, 3), replace=False):
            changed[str(name)] = float((getattr(usual, name) or 0.2) * generator.choice(factors))
        curves = replace(usual, **changed)
        assert (outside_of_curves(curves) is None) == builds(opensim, curves), changed
        refused += outside_of_curves(curves) is not None
    assert 200 < refused < 400


def builds(opensim: Any, curves: MillardCurves) -> bool:
    muscle = opensim.Millard2012EquilibriumMuscle("muscle", 300.0, 0.2, 0.15, 0.0)
    muscle.set_ignore_tendon_compliance(True)
    active = (curves.shortest, curves.transition, curves.longest, curves.shallow_slope, curves.minimum)
    slopes = (curves.concentric_slope, curves.near_concentric_slope, curves.isometric_slope)
    slopes += (curves.eccentric_slope, curves.near_eccentric_slope, curves.strongest)
    passive = (curves.passive_start, curves.passive_end, curves.passive_low_slope, curves.passive_slope)
    try:
        muscle.setActiveForceLengthCurve(opensim.ActiveForceLengthCurve(*active))
        speed = opensim.ForceVelocityCurve(*slopes, curves.concentric_curviness, curves.eccentric_curviness)
        muscle.setForceVelocityCurve(speed)
        muscle.setFiberForceLengthCurve(opensim.FiberForceLengthCurve(*passive, curves.passive_curviness))
        muscle.finalizeFromProperties()
    except RuntimeError:
        return False
    return True


def _with_pennation(pennation: float, steepest: float = MUSCLE.maximum_pennation) -> Model:
    fiber = {"max_isometric_force": 100.0, "optimal_fiber_length": 0.1, "tendon_slack_length": 0.2}
    muscle = replace(MUSCLE, **fiber, pennation_at_optimal=pennation, maximum_pennation=steepest)
    return replace(bundled_model(), muscles=(muscle,))


def test_a_slack_muscle_whose_shortest_fibre_still_pulls_has_its_isometric_force_at_any_speed() -> None:
    """At a pennation of at most 0.7, the fibre is never shorter than 0.1 m sin(0.4) / sin(0.7) = 0.060 m."""
    model = _with_pennation(0.4, steepest=0.7)
    slack = muscle_forces(model, np.full((3, 1), 0.1), np.array([[-0.5], [0.0], [0.5]])).active[:, 0]
    taut = muscle_forces(model, np.array([[0.2 + 0.1 * np.sin(0.4) / np.tan(0.7)]]), np.zeros((1, 1))).active[0, 0]
    assert slack.tolist() == pytest.approx([taut] * 3, rel=1e-13)
    assert taut > 10.0


def test_muscles_with_different_curves_are_in_the_models_order_and_one_of_thelen_may_be_idle() -> None:
    """Below its shortest fibre; a model without muscles has no forces."""
    millard = _with_pennation(0.1).muscles[0]
    thelen = replace(millard, curves=ThelenCurves())
    mixed = replace(bundled_model(), muscles=(thelen, millard, thelen))
    length, speed = np.array([0.15, 0.31, 0.31, 0.31])[:, None], np.linspace(-0.3, 0.3, 4)[:, None]
    forces = muscle_forces(mixed, np.tile(length, 3), np.tile(speed, 3))
    for index, muscle in enumerate(mixed.muscles):
        alone = muscle_forces(replace(mixed, muscles=(muscle,)), length, speed)
        assert np.array_equal(forces.active[:, index], alone.active[:, 0])
        assert np.array_equal(forces.passive[:, index], alone.passive[:, 0])
    assert forces.active[0, 0] == 0.0 and forces.active[1, 0] > 50.0
    assert muscle_forces(replace(mixed, muscles=()), np.zeros((3, 0)), np.zeros((3, 0))).active.shape == (3, 0)
