"""Muscles of an OpenSim file, read and written; and the paths of forces with the surfaces that they wrap over, read.

The writer gives all digits. It writes tendons as rigid (model_writer.py); their curves stay in the file.
"""

from __future__ import annotations

import xml.etree.ElementTree as Xml
from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from documents.interval import counted
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
    outside_of_curves,
)
from solver.model import (
    AnyPathPoint,
    Array,
    ConditionalPathPoint,
    Model,
    MovingPathPoint,
    Muscle,
    Path,
    PathPoint,
    PathWrap,
    Placement,
    SurfaceKind,
    WrapSurface,
)
from solver.multibody.postures import rotation_body_fixed_xyz
from solver.osim.document import Element
from solver.osim.elements import add, add_function, add_values, add_whole_path
from solver.osim.names import Names, OffsetFrame, read_function, read_named_function

MILLARD, THELEN = "Millard2012EquilibriumMuscle", "Thelen2003Muscle"
DE_GROOTE_FREGLY, SCHUTTE = "DeGrooteFregly2016Muscle", "Schutte1993Muscle_Deprecated"
MUSCLES = (MILLARD, THELEN, DE_GROOTE_FREGLY, SCHUTTE)


def read_muscle(element: Element, names: Names, surfaces: Sequence[WrapSurface]) -> Muscle:
    rise, fall = _time_constants(element)
    has_flat_fibers = element.tag in (DE_GROOTE_FREGLY, SCHUTTE)
    steepest = np.pi / 2 if has_flat_fibers else _steepest_pennation(element)
    is_schutte = element.tag == SCHUTTE
    least, greatest = _control_limits(element)
    fastest = 1.0 / _time_scale(element) if is_schutte else element.positive("max_contraction_velocity", "10")
    return Muscle(
        name=element.name,
        path=read_path(geometry_path(element), names, surfaces),
        max_isometric_force=element.not_negative("max_isometric_force", "1000"),
        optimal_fiber_length=element.positive("optimal_fiber_length", "0.1"),
        tendon_slack_length=element.not_negative("tendon_slack_length", "0.2"),
        pennation_at_optimal=_pennation(element),
        maximum_pennation=steepest,
        max_contraction_velocity=fastest,
        activation_time_constant=rise,
        deactivation_time_constant=fall,
        curves=_curves(element),
        tendon=_tendon(element),
        fiber_damping=_fiber_damping(element),
        min_control=least,
        max_control=greatest,
    )


LARGEST_CONTROL = 100.0  # of a muscle; greater ones, and infinite ones, stand for no limit
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
OPTIONS = {
    THELEN: {
        "FmaxMuscleStrain": "passive_strain",
        "KshapeActive": "active_shape",
        "KshapePassive": "passive_shape",
        "Af": "velocity_shape",
        "Flen": "strongest",
        "fv_linear_extrap_threshold": "linear_beyond",
    },
    DE_GROOTE_FREGLY: {"active_force_width_scale": "width", "passive_fiber_strain_at_one_norm_force": "passive_strain"},
}
"""Class of muscle → its property → field of its curves; Millard's muscle has an element for every curve."""


def _control_limits(element: Element) -> tuple[float, float]:
    """Least and greatest control. The default of muscles with a least activation is 0.01, whatever that is.

    A paralysed muscle has a greatest control of 0, and then that default does not hold.
    """
    has_least = element.tag in (MILLARD, THELEN)
    greatest = min(element.number("max_control", "1", may_be_infinite=True), LARGEST_CONTROL)
    default = min(0.01, greatest) if has_least else 0.0
    least = max(0.0, element.number("min_control", f"{default:g}", may_be_infinite=True))
    if least > greatest:
        raise element.refusal(f"has a min_control of {least:g}, expected at most its max_control of {greatest:g}")
    return least, greatest


def _time_constants(element: Element) -> tuple[float, float]:
    """Of activation and deactivation [s]. The rates of Schutte's muscle are those at full and at no excitation.

    A rate of 0, as of the patellar ligament among the muscles of Arnold's leg, makes the time infinite. Without
    activation dynamics, the activation is the excitation and the times are 0.
    """
    if element.flag("ignore_activation_dynamics"):
        return 0.0, 0.0
    if element.tag == SCHUTTE:
        rise, fall = element.not_negative("activation1", "7.667"), element.not_negative("activation2", "1.459854")
        scale = _time_scale(element)
        return scale / (rise + fall) if rise + fall else np.inf, scale / fall if fall else np.inf
    defaults = {MILLARD: ("0.010", "0.040"), DE_GROOTE_FREGLY: ("0.015", "0.060")}
    usual_rise, usual_fall = defaults.get(element.tag, ("0.015", "0.050"))
    rise = element.positive("activation_time_constant", usual_rise)
    return rise, element.positive("deactivation_time_constant", usual_fall)


def _pennation(element: Element) -> float:
    """[rad] From 0 to below a right angle, as in OpenSim, which limits all muscles but Schutte's."""
    pennation = element.number("pennation_angle_at_optimal", "0")
    if element.tag != SCHUTTE and not 0.0 <= pennation < np.pi / 2:
        sentence = f"should have <pennation_angle_at_optimal> from 0 to below π/2 and has {pennation:g} rad; correct it"
        raise element.refusal(sentence, SolverCode.WRONG_PENNATION)
    return pennation


def _steepest_pennation(element: Element) -> float:
    """[rad] From 0 to a right angle, as in OpenSim."""
    steepest = element.number("maximum_pennation_angle", repr(float(np.arccos(0.1))))
    if not 0.0 <= steepest <= np.pi / 2:
        sentence = f"should have <maximum_pennation_angle> from 0 to π/2 and has {steepest:.10g} rad; correct it"
        raise element.refusal(sentence, SolverCode.WRONG_PENNATION)
    return steepest


def _time_scale(element: Element) -> float:
    return element.positive("time_scale", "0.1")


def _millard_curves(element: Element) -> Curves:
    given: dict[str, float] = {}
    for tag, options in MILLARD_OPTIONS.items():
        curve = element.find(tag)
        if curve is not None:
            given |= {name: curve.number(option) for option, name in options.items() if curve.word(option, "")}
    if "passive_slope" not in given:  # OpenSim's own rule for a curve whose slopes are not given
        strain = given.get("passive_end", MillardCurves.passive_end) - given.get("passive_start", 0.0)
        if not strain > 0.0:
            sentence = f"has a passive curve over a strain of {strain:g}, expected one above 0; correct it"
            raise element.refusal(sentence, SolverCode.NOT_POSITIVE)
        given["passive_slope"] = 2.0 / strain
    return _as_integrated(MillardCurves(**given), element)


def _as_integrated(curves: MillardCurves, element: Element) -> MillardCurves:
    """Curves as OpenSim uses them: with fibre damping or a rigid tendon they reach zero.

    Otherwise OpenSim keeps the active force above zero and the ends of the force-velocity curve sloped.
    """
    if _fiber_damping(element) > 0.0 or _has_rigid_tendon(element):
        return replace(curves, minimum=0.0, concentric_slope=0.0, eccentric_slope=0.0)
    return replace(
        curves,
        minimum=max(curves.minimum, LEAST_ACTIVE_FORCE),
        concentric_slope=max(curves.concentric_slope, curves.near_concentric_slope / 2),
        eccentric_slope=max(curves.eccentric_slope, curves.near_eccentric_slope / 2),
    )


def _thelen_curves(element: Element) -> Curves:
    given = {
        name: element.positive(option, above=1.0 if name == "strongest" else 0.0)
        for option, name in OPTIONS[THELEN].items()
        if element.find(option)
    }
    return ThelenCurves(**given)


def _de_groote_fregly_curves(element: Element) -> Curves:
    return DeGrooteFreglyCurves(
        width=element.positive("active_force_width_scale", "1"),
        passive_strain=element.positive("passive_fiber_strain_at_one_norm_force", "0.6"),
        has_passive_force=not element.flag("ignore_passive_fiber_force"),
    )


def _schutte_curves(element: Element) -> Curves:
    active = read_named_function(element, "active_force_length_curve") or SchutteCurves.active
    return SchutteCurves(active, read_named_function(element, "passive_force_length_curve"))


def _curves(element: Element) -> Curves:
    curves = _CURVES[element.tag](element)
    outside = outside_of_curves(curves)
    if outside is not None:
        named = replace(outside, name=f"<{_TAGS[element.tag][outside.name]}>")
        raise element.refusal(f"should have {named}; correct it", SolverCode.WRONG_MUSCLE)
    return curves


_CURVES: dict[str, Callable[[Element], Curves]] = {
    MILLARD: _millard_curves,
    THELEN: _thelen_curves,
    DE_GROOTE_FREGLY: _de_groote_fregly_curves,
    SCHUTTE: _schutte_curves,
}
_TAGS = {MILLARD: {name: option for options in MILLARD_OPTIONS.values() for option, name in options.items()}}
_TAGS |= {tag: {name: option for option, name in options.items()} for tag, options in OPTIONS.items()}
"""Class of muscle → field of its curves → its property."""


def _has_rigid_tendon(element: Element) -> bool:
    return element.flag("ignore_tendon_compliance")


def _fiber_damping(element: Element) -> float:
    """As OpenSim uses it: below a threshold Millard's muscle has none."""
    if element.tag == DE_GROOTE_FREGLY:
        return element.not_negative("fiber_damping", "0")
    if element.tag != MILLARD:
        return 0.0
    damping = element.number("fiber_damping", "0.1")
    return damping if damping >= LEAST_FIBER_DAMPING else 0.0


def _tendon(element: Element) -> TendonCurve | None:
    """None where the file has the tendon rigid, and for Schutte's muscle, whose tendon is not read."""
    if element.tag == SCHUTTE or _has_rigid_tendon(element):
        return None
    if element.tag == THELEN:
        return ThelenTendon(element.positive("FmaxTendonStrain", "0.04"))
    if element.tag == DE_GROOTE_FREGLY:
        return DeGrooteFreglyTendon(element.positive("tendon_strain_at_one_norm_force", "0.049"))
    return _millard_tendon(element.find("TendonForceLengthCurve"))


def _millard_tendon(curve: Element | None) -> MillardTendon:
    """Stiffness, toe and curviness are given together or follow from the strain, as in OpenSim."""
    if curve is None:
        return MillardTendon()
    strain = curve.positive("strain_at_one_norm_force", "0.049")
    if not curve.word("stiffness_at_one_norm_force", ""):
        return MillardTendon(strain, 1.375 / strain)
    stiffness, toe = curve.positive("stiffness_at_one_norm_force"), curve.positive("norm_force_at_toe_end")
    if not (stiffness * strain > 1.0 and toe < 1.0):
        sentence = (
            f"has a stiffness of {stiffness:g} at a strain of {strain:g} and a toe up to {toe:g}, expected a stiffness "
            f"above {1.0 / strain:g} and a toe below 1; correct them"
        )
        raise curve.refusal(sentence)
    return MillardTendon(strain, stiffness, toe, curve.number("curviness", "0.5"))


_CLASSES = {
    MillardCurves: MILLARD,
    ThelenCurves: THELEN,
    DeGrooteFreglyCurves: DE_GROOTE_FREGLY,
    SchutteCurves: SCHUTTE,
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
        add_values(made, **_options(muscle.curves))
        if isinstance(muscle.tendon, ThelenTendon):
            add_values(made, FmaxTendonStrain=muscle.tendon.strain)
    else:
        _add_millard(made, muscle)


def _options(curves: Curves) -> dict[str, float]:
    return {option: getattr(curves, field) for option, field in OPTIONS[_CLASSES[type(curves)]].items()}


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
        **_options(curves),
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


def geometry_path(element: Element) -> Element:
    """The GeometryPath of a force. ModelError for a path whose length is a function of coordinates."""
    if has_function_path(element):
        raise element.refusal(
            "has a FunctionBasedPath, whose length is a function of coordinates and which the solver does not support; "
            "replace it by a GeometryPath, or read the model without such forces (ignore_forces, --ignore-forces)",
            SolverCode.UNSUPPORTED,
        )
    return element.child("GeometryPath")


def has_function_path(element: Element) -> bool:
    return element.find("FunctionBasedPath") is not None


def read_path(element: Element, names: Names, surfaces: Sequence[WrapSurface]) -> Path:
    points = element.objects("PathPointSet")
    if len(points) < 2:
        raise element.refusal(
            f"has {counted(len(points), 'point')}, expected at least 2: its ends", SolverCode.WRONG_PATH
        )
    return Path(
        points=tuple(_point(point, names) for point in points),
        wraps=tuple(_wrap(wrap, surfaces) for wrap in element.objects("PathWrapSet")),
    )


_SURFACES = ("WrapEllipsoid", "WrapSphere", "WrapCylinder", "WrapTorus")
_SIDES = ("all", "x", "+x", "-x", "y", "+y", "-y", "z", "+z", "-z")


def read_surface(frame: OffsetFrame, element: Element) -> WrapSurface:
    """The wrap object that a body or a frame in it holds."""
    if element.tag not in _SURFACES:
        raise element.unsupported("wrap object", ", ".join(_SURFACES))
    quadrant = element.word("quadrant", "all").lower().replace("unassigned", "all")
    if quadrant not in _SIDES:
        raise element.refusal(f"has the quadrant {quadrant}; the solver supports {', '.join(_SIDES)}")
    outer = frame.placement
    rotation = rotation_body_fixed_xyz(element.numbers("xyz_body_rotation", 3, "0 0 0"))
    center = outer.translation + outer.rotation @ element.numbers("translation", 3, "0 0 0")
    placement = Placement(outer.rotation @ rotation, center)
    kind, dimensions = _shape(element)
    is_active = element.flag("active", "true")
    return WrapSurface(element.name, frame.body, placement, kind, dimensions, quadrant, is_active)


def _shape(element: Element) -> tuple[SurfaceKind, Array]:
    if element.tag == "WrapEllipsoid":
        return "ellipsoid", element.numbers("dimensions", 3, "0.05 0.05 0.05")
    if element.tag == "WrapSphere":
        return "sphere", np.full(3, element.positive("radius", "0.05"))
    if element.tag == "WrapTorus":
        return "torus", np.array(
            [element.positive("inner_radius", "0.01"), element.positive("outer_radius", "0.05"), 0.0]
        )
    radius = element.positive("radius", "1")
    return "cylinder", np.array([radius, radius, element.number("length", "1")])


def _point(element: Element, names: Names) -> AnyPathPoint:
    if element.tag == "PathPoint":
        return PathPoint(*names.station(element, "socket_parent_frame", "location"))
    if element.tag == "ConditionalPathPoint":
        body, location = names.station(element, "socket_parent_frame", "location")
        coordinate = names.coordinate(element, element.child("socket_coordinate").text)
        lowest, highest = element.numbers("range", 2, "0 0", may_be_infinite=True)
        return ConditionalPathPoint(body, location, coordinate, (float(lowest), float(highest)))
    if element.tag != "MovingPathPoint":
        raise element.unsupported("path point", "PathPoint, MovingPathPoint, ConditionalPathPoint")
    frame = names.frame(element, "socket_parent_frame")
    drivers = {element.child(f"socket_{axis}_coordinate").text for axis in "xyz"}
    if len(drivers) != 1:
        raise element.refusal(
            "depends on several coordinates, with which OpenSim 4.6 does not open the model; use one",
            SolverCode.UNSUPPORTED,
        )
    coordinate = names.coordinate(element, drivers.pop())
    x, y, z = (read_function(element.child(f"{axis}_location")) for axis in "xyz")
    return MovingPathPoint(frame.body, frame.placement, coordinate, (x, y, z), names.coordinates[coordinate].range)


def _wrap(element: Element, surfaces: Sequence[WrapSurface]) -> PathWrap:
    name = element.child("wrap_object").text
    names = [surface.name for surface in surfaces]
    if name not in names:
        raise element.refusal(f"names an unknown wrap object {name}", SolverCode.UNKNOWN_NAME)
    first, last = (int(number) for number in element.numbers("range", 2, "-1 -1"))
    method = element.word("method", "hybrid")
    if method not in ("hybrid", "midpoint", "axial"):
        raise element.refusal(
            f"has the method {method}; the solver supports hybrid, midpoint and axial", SolverCode.UNSUPPORTED
        )
    # The file counts points from 1; a smaller number means the end of the path.
    return PathWrap(names.index(name), method, max(first, 1) - 1, last - 1 if last > 0 else None)  # type: ignore[arg-type]
