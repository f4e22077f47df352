import numpy as np
import pytest
from numpy.typing import NDArray

from drivers.simulators.marker_frames import Camera
from drivers.simulators.markers import MarkerCloud, Wearer, random_wander
from drivers.simulators.settings import Settings, settings_from_dict
from drivers.simulators.world import World

T = np.arange(0.0, 60.0, 0.05)
LONG_T = np.linspace(0.0, 400.0, 80_001)
WANDER = random_wander(np.random.default_rng(5), np.array([2.0, 0.0, 0.3]), 0.05, 0.8)


def cloud(bench: Settings | None = None, seed: int = 3) -> MarkerCloud:
    bench = bench or Settings()
    return MarkerCloud(bench, Wearer(bench, np.random.default_rng(seed)), seed)


def at(points: NDArray[np.float64], markers: MarkerCloud, label: str) -> NDArray[np.float64]:
    return points[:, markers.labels.index(label)]


def test_the_default_labels_are_those_of_the_example_configuration_and_a_rope_may_carry_no_markers() -> None:
    assert cloud().labels == ("anchor_1", "anchor_2", "anchor_3", "anchor_4", "cuff_1", "rope_1", "rope_2")
    markers = cloud(settings_from_dict({"mocap": {"rope_markers_mm": {}}}))
    assert markers.labels[-1] == "cuff_1"
    assert markers.seen(T[:5], np.zeros(5)).shape == (5, 5, 3)


def test_the_anchor_sways_as_a_rigid_body_that_spans_all_directions() -> None:
    markers = cloud()
    points = markers.true_points(T, np.zeros_like(T))
    anchor = points[:, :4]
    distances = np.linalg.norm(anchor[:, :, None] - anchor[:, None], axis=-1)
    assert np.ptp(distances, axis=0).max() < 1e-9
    assert 1.0 < anchor[:, 0].std(axis=0).mean() < 3.0
    points = cloud().true_points(np.zeros(1), np.zeros(1))[0, :4]
    assert np.linalg.svd(points - points.mean(axis=0), compute_uv=False)[1] > 50.0


def test_a_displaced_cuff_moves_along_the_rope_by_that_much() -> None:
    markers = cloud()
    away = at(markers.true_points(T, np.full_like(T, 0.01)), markers, "cuff_1")
    home = at(markers.true_points(T, np.zeros_like(T)), markers, "cuff_1")
    points = markers.true_points(T, np.zeros_like(T))
    rope = at(points, markers, "rope_2") - at(points, markers, "rope_1")
    rope /= np.linalg.norm(rope, axis=1, keepdims=True)
    assert away - home == pytest.approx(10.0 * rope, abs=1e-9)


def test_the_rope_points_at_its_pulley() -> None:
    bench = Settings()
    markers = cloud(bench)
    points = markers.true_points(T, np.zeros_like(T))
    near, far = at(points, markers, "rope_1"), at(points, markers, "rope_2")
    to_pulley = np.array(bench.rig.pulley_mm) - near
    assert np.linalg.norm(np.cross(far - near, to_pulley), axis=1).max() < 1e-6


def test_sway_along_the_rope_is_that_of_the_cuff_physics() -> None:
    bench = Settings()
    wearer = Wearer(bench, np.random.default_rng(3))
    place, _ = wearer.rope(T)
    mean = place.mean(axis=0)
    direction = np.array(bench.rig.pulley_mm) - mean
    along = (place - mean) @ (direction / np.linalg.norm(direction)) * 1e-3
    reported = wearer.along_rope().value(T)[:, 0]
    assert along - along.mean() == pytest.approx(reported - reported.mean(), abs=3e-5)


def test_marker_noise_has_the_configured_size_on_every_axis() -> None:
    markers = cloud()
    still = np.zeros_like(T)
    noise = markers.seen(T, still) - markers.true_points(T, still)
    assert np.nanstd(noise, axis=(0, 1)) == pytest.approx(np.full(3, 0.2), rel=0.03)


def test_markers_are_hidden_at_the_same_times_for_every_client() -> None:
    bench = settings_from_dict({"mocap": {"occlusions_per_minute": 3.0}})
    markers = cloud(bench)
    hidden = np.isnan(markers.seen(T, np.zeros_like(T))[..., 0])
    again = np.isnan(markers.seen(T[300:400], np.zeros(100))[..., 0])
    assert 0.0005 < hidden.mean() < 0.02
    assert np.array_equal(hidden[300:400], again)


@pytest.mark.parametrize("start", [0.0, 2.5, 11.5, 33.5, 33.13, 1234.57])
def test_a_capture_has_no_frame_at_its_end_however_the_end_is_rounded(start: float) -> None:
    bench = World(settings_from_dict({}), speed=None, seed=1)
    for frames in (549, 1759, 2400):
        camera = Camera(bench, start)
        exposed = camera.frames_before(start + frames / 100.0)
        assert exposed is not None and int(exposed.numbers[-1]) == frames


def test_sway_has_the_size_asked_for_and_rate_integral_and_projection_are_those_of_its_values() -> None:
    assert WANDER.value(LONG_T).std(axis=0) == pytest.approx([2.0, 0.0, 0.3], rel=0.1, abs=1e-12)
    value, dt = WANDER.value(LONG_T), LONG_T[1]
    np.testing.assert_allclose(np.gradient(value, dt, axis=0)[1:-1], WANDER.rate(LONG_T)[1:-1], rtol=1e-6, atol=1e-3)
    np.testing.assert_allclose(
        np.gradient(WANDER.integral(LONG_T), dt, axis=0)[1:-1], value[1:-1], rtol=1e-6, atol=1e-3
    )
    directions = np.array([[1.0], [2.0], [-3.0]])
    np.testing.assert_allclose(
        WANDER.along(directions).value(LONG_T), WANDER.value(LONG_T) @ directions, rtol=1e-6, atol=1e-12
    )
