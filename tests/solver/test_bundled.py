from dataclasses import replace
from importlib.resources import files

import numpy as np
import pytest

from solver.bundled import bundled_model, simulate_arm_raise
from solver.errors import SolverCode
from solver.model import AxisMotion, Model, Motion, MovingPathPoint, ScapulothoracicMotion
from solver.motion import decimate, differentiate
from solver.multibody.constraints import constraint_gaps
from solver.multibody.postures import postures
from solver.osim.model_reader import read_osim
from solver.redundancy.motion_solution import solve_motion
from tests.refusals import raises_refusal
from tests.solver.osim.test_model_writer import assert_same
from tests.solver.references import NO_WEIGHT

MODEL = bundled_model()


@pytest.fixture(scope="module")
def published() -> Model:
    return read_osim(NO_WEIGHT)


def test_the_table_names_its_sources_and_says_that_it_is_a_modification() -> None:
    head = files("solver").joinpath("thoracoscapular.toml").read_text(encoding="utf-8")[:1500]
    for part in ("Seth", "Front. Neurorobot. 13:90", "Belli", "e0295003", "CC BY 4.0", "modification"):
        assert part in head


def test_it_has_the_parts_of_the_published_model() -> None:
    assert len(MODEL.bodies) == 1 + 7
    assert (len(MODEL.coordinates), len(MODEL.muscles), len(MODEL.actuators)) == (17, 33, 17)
    assert MODEL.coordinate_names[:6] == tuple(
        f"ground_thorax_{c}" for c in ("rot_x", "rot_y", "rot_z", "tx", "ty", "tz")
    )
    assert [c.motion for c in MODEL.coordinates] == ["rotation"] * 3 + ["translation"] * 3 + ["rotation"] * 11


@pytest.mark.shared
def test_bodies_joints_and_all_but_muscles_are_the_published_ones(published: Model) -> None:
    for part in ("gravity", "coordinates", "bodies", "actuators", "constraints"):
        assert_same(getattr(MODEL, part), getattr(published, part), part, atol=0.0)
    free, known = (tuple(replace(m, is_fixed=False) for m in model.markers) for model in (MODEL, published))
    assert_same(free, known, "markers", atol=0.0)
    for ours, theirs in zip(MODEL.joints, published.joints, strict=True):
        assert_same(replace(ours, motion=None), replace(theirs, motion=None), atol=0.0)  # type: ignore[arg-type]
        assert _driven_axes(ours.motion) == _driven_axes(theirs.motion)


@pytest.mark.shared
def test_muscles_and_their_paths_are_the_published_ones(published: Model) -> None:
    for ours, theirs in zip(MODEL.muscles, published.muscles, strict=True):
        assert vars(ours) | {"path": None} == vars(theirs) | {"path": None}
        for point, other in zip(ours.path.points, theirs.path.points, strict=True):
            assert type(point) is type(other)
            if isinstance(point, MovingPathPoint):
                assert (point.body, point.coordinate, point.range) == (other.body, other.coordinate, other.range)
                ends = np.array(point.range)
                for function, same in zip(point.functions, other.functions, strict=True):
                    assert np.allclose(function.derivatives(ends), same.derivatives(ends), rtol=0, atol=1e-16)
            else:
                assert_same(point, other, atol=0.0)
        for wrap, other_wrap in zip(ours.path.wraps, theirs.path.wraps, strict=True):
            assert wrap.method == other_wrap.method
            assert_same(MODEL.surfaces[wrap.surface], published.surfaces[other_wrap.surface], atol=0.0)


def _driven_axes(motion: Motion) -> list[object]:
    """What moves, in order; an axis that nothing drives leaves no trace."""
    if isinstance(motion, ScapulothoracicMotion):
        return [motion.coordinates, motion.radii.tolist(), motion.winging_origin.tolist(), motion.winging_direction]
    assert isinstance(motion, AxisMotion)
    still, unit = np.array([0.0]), np.array([0.0, 1.0])
    rows = []
    for kind, (axis, driver, function) in enumerate(zip(motion.axes, motion.coordinate, motion.functions, strict=True)):
        value, slope, curvature = function.derivatives(still if driver < 0 else unit)
        if driver < 0:
            assert not value.any()
        else:
            rows.append((int(driver), kind // 3, axis.tolist(), value.tolist(), slope.tolist(), curvature.tolist()))
    return rows


# The bundled motion: it closes its joint, is smooth, goes where it says, and muscles alone hold it up.


@pytest.fixture(scope="module")
def kinematics():
    return differentiate(simulate_arm_raise(MODEL))


def test_the_arm_goes_from_15_degrees_past_90_and_back():
    motion = simulate_arm_raise(MODEL)
    elevation = np.degrees(motion.coordinates[:, MODEL.coordinate_index("shoulder_elv")])
    assert elevation[[0, -1]] == pytest.approx([15, 15])
    assert elevation.max() == pytest.approx(100)
    rising = elevation[: len(elevation) // 2]
    assert (np.diff(rising) >= 0).all()


def test_the_acromioclavicular_gap_stays_below_a_micrometre_also_after_the_filter(kinematics):
    for coordinates in (simulate_arm_raise(MODEL).coordinates, kinematics.positions):
        gaps = constraint_gaps(MODEL, postures(MODEL, coordinates, np.zeros_like(coordinates)))
        assert np.linalg.norm(gaps, axis=-1).max() < 1e-6


def test_the_scapula_moves_with_the_arm(kinematics):
    upward = np.degrees(np.ptp(kinematics.positions[:, MODEL.coordinate_index("scapula_upward_rot")]))
    assert 30 < upward < 60


def test_accelerations_are_small_and_without_steps(kinematics):
    assert np.abs(kinematics.accelerations).max() < 3  # rad/s²
    assert np.abs(np.diff(kinematics.accelerations, axis=0)).max() < 0.15
    np.testing.assert_allclose(kinematics.accelerations[[0, -1]], 0, atol=1e-3)


def test_no_frame_is_held_up_by_reserve_actuators(kinematics):
    result = solve_motion(MODEL, decimate(kinematics, 20))
    shoulder = [index for index, a in enumerate(MODEL.actuators) if 6 <= a.coordinate <= 14]
    assert len(shoulder) == 9
    assert result.unsolved == 0
    assert np.abs(result.reserves[:, shoulder]).max() < 0.02  # N m; the arm's weight makes some 10 N m


def test_an_assembly_at_its_limit_of_steps_gives_no_motion(monkeypatch):
    monkeypatch.setattr("solver.bundled.MOST_STEPS", 1)
    with raises_refusal(SolverCode.OPEN_JOINT):
        simulate_arm_raise(replace(MODEL))  # another model than that of the motion that is kept
