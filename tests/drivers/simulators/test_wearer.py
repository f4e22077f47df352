"""The person of the simulated bench: shoulder, markers, cord and electrodes over a pose and a motion."""

import numpy as np
import pytest
from scipy.linalg import expm

from drivers.simulators.errors import SimulatorCode
from drivers.simulators.shoulder import SEGMENTS, Screws, published_shoulder
from drivers.simulators.wearer import EmgNoise, RaisedPosture
from drivers.simulators.world import World
from tests.conftest import SHARED
from tests.drivers.simulators.test_world import play, world
from tests.refusals import raises_refusal

STILL = {"soft_tissue_mm": 0.0, "sway_mm": 0.0, "sway_deg": 0.0}
WIRED = {"wiring": {"emg": {"deltoid": {"input": "ai2", "gain": 500.0}}}}


def person_world(**person: object) -> World:
    clear = {"noise_mm": 0.0, "occlusions_per_minute": 0.0}
    return world(person={"raises": {"cycles": 3}, **person}, mocap=clear, **WIRED)


def labelled(bench: World, t: np.ndarray, *labels: str) -> np.ndarray:
    return bench.markers(t)[:, [bench.labels.index(label) for label in labels]]


def elevation(bench: World, t: np.ndarray) -> np.ndarray:
    """Degrees between the upper arm and the trunk."""
    shoulder, elbow, upper, lower = np.moveaxis(labelled(bench, t, "ac", "EpL", "c7", "t8"), 1, 0)
    arm, trunk = elbow - shoulder, lower - upper
    cosine = np.sum(arm * trunk, axis=1) / np.linalg.norm(arm, axis=1) / np.linalg.norm(trunk, axis=1)
    return np.degrees(np.arccos(cosine))


def test_a_motion_raises_the_arm_as_often_as_it_is_set() -> None:
    bench = person_world(**STILL)
    bench.select_trial(None, "motion", "unsuited")
    capture, t = play(bench)
    angle = elevation(bench, t)
    is_up = angle > 80.0
    assert np.count_nonzero(is_up[1:] & ~is_up[:-1]) == 3
    assert angle[[0, -1]] == pytest.approx(32.7, abs=0.5)
    assert capture.trial.condition == "unsuited"


def test_a_pose_is_held_and_its_markers_move_with_the_soft_tissue() -> None:
    bench = person_world(soft_tissue_mm=3.0, sway_mm=0.0, sway_deg=0.0, pose_s=100.0)
    bench.select_trial(None, "pose")
    _, t = play(bench)
    spread = labelled(bench, t, *bench.person.labels[:11]).std(axis=0)  # type: ignore[union-attr]
    assert np.sqrt(np.mean(spread**2)) == pytest.approx(3.0, rel=0.15)


def test_the_suit_is_seen_where_it_is_worn_and_pulls_where_it_is_tight() -> None:
    bench = person_world(**STILL)
    found = {}
    for worn in ("unsuited", "slack", "tight"):
        bench.select_trial(None, "motion", worn)  # type: ignore[arg-type]
        _, t = play(bench)
        cord = labelled(bench, t, "cord_waist", "cord_shoulder", "cord_arm")
        found[worn] = np.isfinite(cord).all(), float(bench.cell_force(t).max())
        length = np.linalg.norm(np.diff(cord, axis=1), axis=2).sum(axis=1) * 1e-3
        if worn == "tight":
            np.testing.assert_allclose(bench.cell_force(t), 500 * np.maximum(0, length - 0.73), atol=1e-9)
    assert found["unsuited"] == (False, 0.0)
    assert found["slack"] == (True, 0.0)
    assert found["tight"][0] and 20 < found["tight"][1] < 80


def test_emg_is_noise_in_its_band_with_the_muscle_s_activation_for_amplitude() -> None:
    bench = person_world()
    bench.select_trial(None, "motion", "mvc")
    _, t = play(bench)
    t = np.arange(t[0], t[-1], 1e-3)
    volts, person = bench.emg_voltage("deltoid", t), bench.person
    active = person.activation("deltoid", t)
    assert active.max() == pytest.approx(1.0, abs=0.1)
    for part in (active > 0.8, active < 0.04):
        expected = 500 * 0.5e-3 * np.sqrt(np.mean(active[part] ** 2))
        assert np.sqrt(np.mean(volts[part] ** 2)) == pytest.approx(expected, rel=0.2)
    np.testing.assert_array_equal(bench.emg_voltage("deltoid", t[500:600]), volts[500:600])


def test_emg_noise_has_variance_one_and_nothing_outside_its_band() -> None:
    noise = EmgNoise(np.random.default_rng(1))(np.arange(0, 16.0, 1 / 4096))
    power = np.abs(np.fft.rfft(noise)) ** 2
    frequency = np.fft.rfftfreq(len(noise), 1 / 4096)
    inside = (frequency > 19.9) & (frequency < 450.1)
    assert noise.std() == pytest.approx(1.0)
    assert power[~inside].sum() < 1e-6 * power.sum()


def test_a_tight_cord_relieves_the_muscle() -> None:
    bench = person_world()
    highest = {}
    for worn in ("slack", "tight"):
        bench.select_trial(None, "motion", worn)  # type: ignore[arg-type]
        _, t = play(bench)
        highest[worn] = bench.person.activation("deltoid", t).max()
    assert highest["tight"] < 0.85 * highest["slack"]


def test_a_person_s_trial_needs_a_person_in_the_settings_and_no_cuff() -> None:
    with raises_refusal(SimulatorCode.UNKNOWN_TRIAL, "no person"):
        world().select_trial(None, "motion", "tight")
    with raises_refusal(SimulatorCode.UNKNOWN_TRIAL, "a pose and a motion have no cuff"):
        person_world().select_trial("hand", "pose")


def test_the_load_cell_is_back_in_the_rope_for_a_cuff() -> None:
    bench = person_world()
    bench.select_trial(None, "motion", "tight")
    play(bench)
    bench.select_trial("hand", "static")
    capture, t = play(bench)
    assert capture.trial.cuff == "hand"
    assert bench.cell_force(t).max() > 70


@pytest.mark.shared
def test_its_segments_are_where_opensim_puts_them() -> None:
    golden = np.load(SHARED / "golden.npz")
    shoulder, names = published_shoulder(), list(golden["coords"])
    coordinates = golden["q"][:, [names.index(name) for name in shoulder.coordinate_names]]
    poses = shoulder.poses(coordinates)
    for segment in SEGMENTS:
        body = list(golden["bodies"]).index(segment)
        np.testing.assert_allclose(poses[segment][:, :3, :3], golden["R"][:, body], atol=1e-12)
        np.testing.assert_allclose(poses[segment][:, :3, 3], golden["p"][:, body], atol=1e-12)


def test_the_exponential_of_a_screw_is_that_of_its_matrix() -> None:
    axis, point = np.array([0.6, 0.0, -0.8]), np.array([0.1, -0.2, 0.3])
    for is_turn in (True, False):
        x, y, z = axis if is_turn else np.zeros(3)
        linear = -np.cross(axis, point) if is_turn else axis
        twist = np.array([[0, -z, y, linear[0]], [z, 0, -x, linear[1]], [-y, x, 0, linear[2]], [0, 0, 0, 0]])
        amounts = np.array([-1.2, 0.0, 0.4])
        found = Screws(axis[None], point[None], np.array([is_turn])).exponentials(amounts[:, None])[:, 0]
        np.testing.assert_allclose(found, [expm(amount * twist) for amount in amounts], atol=1e-12)


def test_the_acromioclavicular_joint_is_closed_all_the_way_up_or_refused() -> None:
    shoulder = published_shoulder()
    coordinates = RaisedPosture(shoulder)(np.linspace(0.0, 1.0, 97))
    assert np.abs(shoulder.gap(coordinates)).max() < 1e-8
    raised = np.degrees(coordinates[[0, -1], shoulder.index("shoulder_elv")])
    np.testing.assert_allclose(raised, [15.0, 100.0], atol=1e-9)
    shoulder = published_shoulder()
    apart = np.zeros((1, len(shoulder.coordinate_names)))
    with raises_refusal(SimulatorCode.OPEN_JOINT):
        shoulder.closed(apart, ("plane_elv", "shoulder_elv", "axial_rot"))
