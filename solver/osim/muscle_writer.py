"""Muscles in an OpenSim document, with all digits. Tendons are rigid, see writer.py; their curves stay in the file."""

from __future__ import annotations

import xml.etree.ElementTree as Xml

from solver.functions.fibre import DeGrooteFreglyCurves, MillardCurves, SchutteCurves, ThelenCurves
from solver.functions.tendon import DeGrooteFreglyTendon, MillardTendon, ThelenTendon
from solver.model import Model, Muscle
from solver.osim.function_writer import add_function
from solver.osim.muscles import MILLARD_OPTIONS, THELEN_OPTIONS
from solver.osim.path_writer import add_whole_path
from solver.osim.xml_elements import add, add_values

_CLASSES = {
    MillardCurves: "Millard2012EquilibriumMuscle",
    ThelenCurves: "Thelen2003Muscle",
    DeGrooteFreglyCurves: "DeGrooteFregly2016Muscle",
    SchutteCurves: "Schutte1993Muscle_Deprecated",
}


_ALWAYS_ELASTIC = (ThelenCurves, SchutteCurves)  # OpenSim has no rigid tendon for their muscles


def add_muscle(objects: Xml.Element, model: Model, muscle: Muscle) -> None:
    made = add(objects, _CLASSES[type(muscle.curves)], muscle.name)
    add_whole_path(made, model, muscle.path, muscle.name)
    add_values(
        made,
        max_isometric_force=muscle.max_isometric_force,
        optimal_fiber_length=muscle.optimal_fiber_length,
        tendon_slack_length=muscle.tendon_slack_length,
        pennation_angle_at_optimal=muscle.pennation_at_optimal,
        min_control=muscle.min_control,
        max_control=muscle.max_control,
        ignore_tendon_compliance=not isinstance(muscle.curves, _ALWAYS_ELASTIC),
        ignore_activation_dynamics=not _has_activation_dynamics(muscle),
    )
    if isinstance(muscle.curves, SchutteCurves):
        _add_schutte(made, muscle, muscle.curves)
        return
    add_values(made, max_contraction_velocity=muscle.max_contraction_velocity)
    if _has_activation_dynamics(muscle):
        add_values(
            made,
            activation_time_constant=muscle.activation_time_constant,
            deactivation_time_constant=muscle.deactivation_time_constant,
        )
    if isinstance(muscle.curves, DeGrooteFreglyCurves):
        _add_de_groote_fregly(made, muscle, muscle.curves)
        return
    add_values(made, maximum_pennation_angle=muscle.maximum_pennation)
    if isinstance(muscle.curves, ThelenCurves):
        add_values(made, **{option: getattr(muscle.curves, field) for option, field in THELEN_OPTIONS.items()})
        if isinstance(muscle.tendon, ThelenTendon):
            add_values(made, FmaxTendonStrain=muscle.tendon.strain)
    else:
        _add_millard(made, muscle)


def _has_activation_dynamics(muscle: Muscle) -> bool:
    return muscle.activation_time_constant > 0.0 or muscle.deactivation_time_constant > 0.0


def _add_millard(made: Xml.Element, muscle: Muscle) -> None:
    add_values(made, fiber_damping=muscle.fiber_damping)
    for tag, options in MILLARD_OPTIONS.items():
        curve = add(made, tag, f"{muscle.name}_{tag}")
        add_values(curve, **{option: getattr(muscle.curves, field) for option, field in options.items()})
    if isinstance(muscle.tendon, MillardTendon):
        tendon = muscle.tendon
        add_values(
            add(made, "TendonForceLengthCurve", f"{muscle.name}_TendonForceLengthCurve"),
            strain_at_one_norm_force=tendon.strain,
            stiffness_at_one_norm_force=tendon.stiffness,
            norm_force_at_toe_end=tendon.toe_force,
            curviness=tendon.curviness,
        )


def _add_de_groote_fregly(made: Xml.Element, muscle: Muscle, curves: DeGrooteFreglyCurves) -> None:
    add_values(
        made,
        active_force_width_scale=curves.width,
        passive_fiber_strain_at_one_norm_force=curves.passive_strain,
        ignore_passive_fiber_force=not curves.has_passive_force,
        fiber_damping=muscle.fiber_damping,
    )
    if isinstance(muscle.tendon, DeGrooteFreglyTendon):
        add_values(made, tendon_strain_at_one_norm_force=muscle.tendon.strain)


def _add_schutte(made: Xml.Element, muscle: Muscle, curves: SchutteCurves) -> None:
    """Its file has rates: activation2 at no excitation, and activation1 more at full excitation, over a time scale."""
    scale = 1.0 / muscle.max_contraction_velocity
    add_values(made, time_scale=scale)
    if _has_activation_dynamics(muscle):
        fall = scale / muscle.deactivation_time_constant
        rise = scale / muscle.activation_time_constant - fall
        add_values(made, activation1=rise, activation2=fall)
    add_function(made, curves.active, muscle.name, "active_force_length_curve")
    if curves.passive is not None:
        add_function(made, curves.passive, muscle.name, "passive_force_length_curve")
