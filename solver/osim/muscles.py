"""Muscles and actuators in an OpenSim file."""

from __future__ import annotations

from solver.model import CoordinateActuator, Muscle, WrapSurface
from solver.osim.document import Element
from solver.osim.frames import Names
from solver.osim.paths import read_path


def read_muscle(element: Element, names: Names, surfaces: list[WrapSurface]) -> Muscle:
    for tag, options in _CURVES.items():
        _check_curve(element.child(tag), options)
    return Muscle(
        name=element.name,
        path=read_path(element.child("GeometryPath"), names, surfaces),
        max_isometric_force=element.number("max_isometric_force"),
        optimal_fiber_length=element.number("optimal_fiber_length"),
        tendon_slack_length=element.number("tendon_slack_length"),
        pennation_at_optimal=element.number("pennation_angle_at_optimal", "0"),
        max_contraction_velocity=element.number("max_contraction_velocity", "10"),
        activation_time_constant=element.number("activation_time_constant", "0.010"),
        deactivation_time_constant=element.number("deactivation_time_constant", "0.040"),
    )


def read_actuator(element: Element, names: Names) -> CoordinateActuator:
    element.require("min_control", "-Inf")
    element.require("max_control", "Inf")
    coordinate = names.coordinate(element, element.child("coordinate").text)
    return CoordinateActuator(element.name, coordinate, element.number("optimal_force", "1"))


# The solver has one shape of each curve (muscle.py). It is what OpenSim takes where a file is silent, but for
# minimum_value, which therefore must be written.
_CURVES = {
    "ActiveForceLengthCurve": {
        "min_norm_active_fiber_length": 0.4441,
        "transition_norm_fiber_length": 0.73,
        "max_norm_active_fiber_length": 1.8123,
        "shallow_ascending_slope": 0.8616,
        "minimum_value": 0.0,
    },
    "ForceVelocityCurve": {
        "concentric_slope_at_vmax": 0.0,
        "concentric_slope_near_vmax": 0.25,
        "isometric_slope": 5.0,
        "eccentric_slope_at_vmax": 0.0,
        "eccentric_slope_near_vmax": 0.15,
        "max_eccentric_velocity_force_multiplier": 1.4,
        "concentric_curviness": 0.6,
        "eccentric_curviness": 0.9,
    },
    "FiberForceLengthCurve": {
        "strain_at_zero_force": 0.0,
        "strain_at_one_norm_force": 0.7,
        "stiffness_at_low_force": 0.2,
        "stiffness_at_one_norm_force": 2.0 / 0.7,
        "curviness": 0.75,
    },
}


def _check_curve(curve: Element, options: dict[str, float]) -> None:
    if "minimum_value" in options:
        curve.child("minimum_value")
    for option in curve.children:
        if option.tag not in options or option.text == "":
            continue
        value, expected = curve.number(option.tag), options[option.tag]
        if abs(value - expected) > 1e-12:
            raise option.refusal(f"of {curve.name} is {value}; the solver's curve has {expected}")
