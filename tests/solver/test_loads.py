"""External loads: wrenches by hand, OpenSim's files read with their quirks, and a sentence for each fault."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from solver.bundled import bundled_model
from solver.kinematics import postures
from solver.loads import ExternalForce, load_wrenches, read_external_loads
from solver.model import ModelError, with_point_mass
from solver.motion import MotionError, differentiate, thin, write_table
from solver.raise_arm import raise_arm
from solver.redundancy import RedundancyOptions, solve_motion

MODEL = bundled_model()
HAND, THORAX = MODEL.body_index("hand"), MODEL.body_index("thorax")
TIME = np.linspace(0.0, 1.0, 5)
XML = """<OpenSimDocument Version="40000"><ExternalLoads name="loads"><objects>
<ExternalForce name="handle">
<appliesForce>true</appliesForce>
<applied_to_body>hand</applied_to_body>
<force_expressed_in_body>ground</force_expressed_in_body>
<point_expressed_in_body>/bodyset/hand</point_expressed_in_body>
<force_identifier>handle_v</force_identifier>
<point_identifier>handle_p</point_identifier>
</ExternalForce>
</objects><datafile>handle.mot</datafile></ExternalLoads></OpenSimDocument>"""

FORCE = "<force_identifier>handle_v</force_identifier>"


@pytest.fixture
def files(tmp_path: Path) -> Path:
    """The XML; beside it its data, a force of (t, 2 t, 3) N at (0.1, 0.2, 0.3) m of the hand."""
    names = [f"handle_{part}{axis}" for part in "vp" for axis in "xyz"]
    values = np.column_stack([TIME, 2 * TIME, np.full((5, 4), [3.0, 0.1, 0.2, 0.3])])
    write_table(tmp_path / "handle.mot", names, TIME, values)
    file = tmp_path / "handle.xml"
    file.write_text(XML)
    return file


def still(frames: int) -> np.ndarray:
    return np.tile(MODEL.default_coordinates, (frames, 1))


def test_columns_are_taken_at_the_frames_of_the_motion(files: Path) -> None:
    (load,) = read_external_loads(files, MODEL, np.array([0.0, 0.3, 0.9]))
    assert (load.body, load.axes, load.origin) == (HAND, 0, HAND)
    np.testing.assert_allclose(load.force, [[0, 0, 3], [0.3, 0.6, 3], [0.9, 1.8, 3]], atol=1e-12)
    np.testing.assert_allclose(load.point, np.tile([0.1, 0.2, 0.3], (3, 1)), atol=1e-12)
    assert not load.torque.any()


def test_a_load_is_a_wrench_about_the_grounds_origin() -> None:
    state = postures(MODEL, still(2), still(2))
    force, torque, point = (np.tile(row, (2, 1)) for row in ([1.0, 2, 3], [0.1, 0.2, 0.3], [0.4, 0.5, 0.6]))
    (wrench, _) = load_wrenches([ExternalForce("pull", HAND, 0, force, torque, 0, point)], state)
    np.testing.assert_allclose(wrench[HAND, 3:], [1, 2, 3])
    np.testing.assert_allclose(wrench[HAND, :3], np.cross(point[0], force[0]) + torque[0])
    assert not np.delete(wrench, HAND, axis=0).any()


@pytest.mark.parametrize("where", ["{folder}/handle.mot", "data/../handle.mot", ".\\handle.mot"])
def test_the_data_file_is_absolute_or_beside_the_file_of_loads(files: Path, where: str) -> None:
    (files.parent / "data").mkdir()
    files.write_text(XML.replace(">handle.mot<", f">{where.format(folder=files.parent)}<"))
    assert len(read_external_loads(files, MODEL, TIME)) == 1


def test_what_is_switched_off_is_left_out(files: Path) -> None:
    for on, off in (("appliesForce>true", "appliesForce>false"), ("<appliesForce>true</appliesForce>", DISABLED)):
        files.write_text(XML.replace(on, off))
        assert read_external_loads(files, MODEL, TIME) == ()


DISABLED = "<isDisabled>true</isDisabled>"  # OpenSim 3


def test_a_body_that_is_not_named_is_the_ground(files: Path) -> None:
    files.write_text(XML.replace(">ground<", "><"))
    assert read_external_loads(files, MODEL, TIME)[0].axes == 0


@pytest.mark.parametrize(
    ("old", "new", "sentence"),
    [
        (">hand<", ">paw<", r"handle\.xml, line 2: ExternalForce handle has the applied_to_body paw, .* thorax, "),
        ("/bodyset/hand", "paw", "has the point_expressed_in_body paw"),
        ("handle_v", "lever_v", r"needs three columns of handle\.mot that begin with lever_v, and there are 0"),
        ("handle_v", "handle_", "begin with handle_, and there are 6"),
        (FORCE, "", "names neither force nor torque"),
        (FORCE, "<torque_identifier>handle_v</torque_identifier>", "names a point and no force"),
        ("<datafile>handle.mot</datafile>", "", "names no <datafile>"),
        ("ExternalForce", "PrescribedForce", "PrescribedForce handle is a load the solver does not have"),
        ("</objects>", "", r"handle\.xml is not well-formed XML: mismatched tag in line 10"),
        ("ExternalLoads", "ForceSet", "OpenSimDocument holds no ExternalLoads"),
    ],
)
def test_a_fault_in_the_file_of_loads_is_one_sentence(files: Path, old: str, new: str, sentence: str) -> None:
    assert old in XML
    files.write_text(XML.replace(old, new))
    with pytest.raises(ModelError, match=sentence):
        read_external_loads(files, MODEL, TIME)


def test_a_fault_in_its_data_is_one_sentence(files: Path) -> None:
    with pytest.raises(MotionError, match=r"handle\.mot should cover the motion, 0 to 1\.5 s, and has 0 to 1 s; cut"):
        read_external_loads(files, MODEL, 1.5 * TIME)
    data = files.with_name("handle.mot")
    text = data.read_text()
    data.write_text(text.replace("\n0.5\t", "\n0.2\t"))
    with pytest.raises(MotionError, match="begin with a column time that increases"):
        read_external_loads(files, MODEL, TIME)
    data.unlink()
    with pytest.raises(MotionError, match=r"handle\.mot should be a motion file and cannot be read"):
        read_external_loads(files, MODEL, TIME)


def test_a_weight_hung_on_the_hand_is_as_dear_as_one_that_the_model_carries() -> None:
    # slowly: the weight's inertia, which a force has not, hardly counts
    motion = thin(differentiate(raise_arm(MODEL)), 40)
    frames, place = len(motion.time), MODEL.bodies[HAND].mass_center
    pull = np.tile(2.0 * MODEL.gravity, (frames, 1))
    hung = ExternalForce("weight", HAND, 0, pull, 0 * pull, HAND, np.tile(place, (frames, 1)))
    carried = solve_motion(with_point_mass(MODEL, "hand", 2.0, place), motion)
    found, bare = solve_motion(MODEL, motion, loads=[hung]), solve_motion(MODEL, motion)
    assert np.abs(found.activations - carried.activations).mean() < 0.01
    assert carried.effort.sum() > 1.5 * bare.effort.sum()
    assert found.effort.sum() == pytest.approx(carried.effort.sum(), rel=0.1)


def test_loads_that_cancel_change_nothing() -> None:
    motion = thin(differentiate(raise_arm(MODEL)), 100)
    pull = np.tile([30.0, -20.0, 10.0], (len(motion.time), 1))
    pair = [ExternalForce(name, THORAX, 0, sign * pull, 0 * pull, 0, 0 * pull) for name, sign in (("a", 1), ("b", -1))]
    options = RedundancyOptions()
    loaded, bare = solve_motion(MODEL, motion, options, loads=pair), solve_motion(MODEL, motion, options)
    np.testing.assert_allclose(loaded.activations, bare.activations, atol=1e-9)
