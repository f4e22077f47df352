"""Figures that no muscle can have are refused with the names of muscle and figure; OpenSim refuses the same."""

from __future__ import annotations

from dataclasses import fields, replace
from typing import Any

import numpy as np
import pytest

from solver.bundled import bundled_model
from solver.errors import SolverCode
from solver.functions.fibre import Curves, DeGrooteFreglyCurves, MillardCurves, ThelenCurves
from solver.functions.fibre_limits import outside_of_curves
from tests.solver.refusals import raises_refusal

MUSCLE = bundled_model().muscles[0]
AS_INTEGRATED = ("minimum", "concentric_slope", "eccentric_slope")  # which OpenSim replaces by 0 with a rigid tendon


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
