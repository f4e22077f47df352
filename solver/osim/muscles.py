"""Muscles and actuators in an OpenSim file."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from solver.functions.fibre import Curves, MillardCurves, ThelenCurves
from solver.model import CoordinateActuator, Muscle, WrapSurface
from solver.osim.document import Element
from solver.osim.frames import Names
from solver.osim.paths import read_path


def read_muscle(element: Element, names: Names, surfaces: list[WrapSurface]) -> Muscle:
    is_millard = element.tag == "Millard2012EquilibriumMuscle"
    rise, fall = ("0.010", "0.040") if is_millard else ("0.015", "0.050")
    return Muscle(
        name=element.name,
        path=read_path(element.child("GeometryPath"), names, surfaces),
        max_isometric_force=element.number("max_isometric_force", "1000"),
        optimal_fiber_length=element.number("optimal_fiber_length", "0.1"),
        tendon_slack_length=element.number("tendon_slack_length", "0.2"),
        pennation_at_optimal=element.number("pennation_angle_at_optimal", "0"),
        maximum_pennation=element.number("maximum_pennation_angle", repr(float(np.arccos(0.1)))),
        max_contraction_velocity=element.number("max_contraction_velocity", "10"),
        activation_time_constant=element.number("activation_time_constant", rise),
        deactivation_time_constant=element.number("deactivation_time_constant", fall),
        curves=_millard_curves(element) if is_millard else _thelen_curves(element),
    )


def read_actuator(element: Element, names: Names) -> CoordinateActuator:
    least, greatest = element.number("min_control", "-inf"), element.number("max_control", "inf")
    if not least <= greatest:
        raise element.refusal(f"has a min_control of {least:g} above its max_control of {greatest:g}; exchange them")
    return CoordinateActuator(
        name=element.name,
        coordinate=names.coordinate(element, element.child("coordinate").text),
        optimal_force=element.number("optimal_force", "1"),
        min_control=least,
        max_control=greatest,
    )


LEAST_FIBER_DAMPING, LEAST_ACTIVE_FORCE = 0.001, 0.1

MILLARD_OPTIONS = {
    "ActiveForceLengthCurve": {
        "min_norm_active_fiber_length": "shortest",
        "transition_norm_fiber_length": "transition",
        "max_norm_active_fiber_length": "longest",
        "shallow_ascending_slope": "shallow_slope",
        "minimum_value": "minimum",
    },
    "ForceVelocityCurve": {
        "concentric_slope_at_vmax": "concentric_slope",
        "concentric_slope_near_vmax": "near_concentric_slope",
        "isometric_slope": "isometric_slope",
        "eccentric_slope_at_vmax": "eccentric_slope",
        "eccentric_slope_near_vmax": "near_eccentric_slope",
        "max_eccentric_velocity_force_multiplier": "strongest",
        "concentric_curviness": "concentric_curviness",
        "eccentric_curviness": "eccentric_curviness",
    },
    "FiberForceLengthCurve": {
        "strain_at_zero_force": "passive_start",
        "strain_at_one_norm_force": "passive_end",
        "stiffness_at_low_force": "passive_low_slope",
        "stiffness_at_one_norm_force": "passive_slope",
        "curviness": "passive_curviness",
    },
}
_THELEN = {
    "FmaxMuscleStrain": "passive_strain",
    "KshapeActive": "active_shape",
    "KshapePassive": "passive_shape",
    "Af": "velocity_shape",
    "Flen": "strongest",
    "fv_linear_extrap_threshold": "linear_beyond",
}


def _millard_curves(element: Element) -> Curves:
    given: dict[str, float] = {}
    for tag, options in MILLARD_OPTIONS.items():
        curve = element.find(tag)
        if curve is not None:
            given |= {name: curve.number(option) for option, name in options.items() if curve.word(option, "")}
    if "passive_slope" not in given:  # OpenSim's own rule for a curve whose slopes are not given
        strain = given.get("passive_end", MillardCurves.passive_end) - given.get("passive_start", 0.0)
        given["passive_slope"] = 2.0 / strain
    return _as_integrated(MillardCurves(**given), element)


def _as_integrated(curves: MillardCurves, element: Element) -> MillardCurves:
    """Curves as OpenSim uses them: with fibre damping or a rigid tendon they reach zero.

    Otherwise OpenSim keeps the active force above zero and the ends of the force-velocity curve sloped.
    """
    is_damped = element.number("fiber_damping", "0.1") >= LEAST_FIBER_DAMPING
    if is_damped or element.word("ignore_tendon_compliance", "false") == "true":
        return replace(curves, minimum=0.0, concentric_slope=0.0, eccentric_slope=0.0)
    return replace(
        curves,
        minimum=max(curves.minimum, LEAST_ACTIVE_FORCE),
        concentric_slope=max(curves.concentric_slope, curves.near_concentric_slope / 2),
        eccentric_slope=max(curves.eccentric_slope, curves.near_eccentric_slope / 2),
    )


def _thelen_curves(element: Element) -> Curves:
    return ThelenCurves(**{name: element.number(option) for option, name in _THELEN.items() if element.find(option)})
