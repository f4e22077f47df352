"""External loads in OpenSim's files: read with their quirks, and a sentence for each fault."""

import sys
from pathlib import Path

import numpy as np
import pytest

from solver.bundled import bundled_model
from solver.errors import SolverCode
from solver.osim.loads_document import LoadsDocument, read_external_loads, read_loads_document
from solver.time_series_table import read_table, write_table
from tests.refusals import raises_refusal

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
DISABLED = "<isDisabled>true</isDisabled>"  # OpenSim 3
OTHER_CASE = pytest.param("Handle.MOT", marks=pytest.mark.skipif(sys.platform == "win32", reason="the same name there"))
NAMES = [f"handle_{part}{axis}" for part in "vp" for axis in "xyz"]
MOVED = XML.replace(">handle.mot<", ">{}<")


@pytest.fixture
def files(tmp_path: Path) -> Path:
    """The XML; in the same folder its data, a force of (t, 2 t, 3) N at (0.1, 0.2, 0.3) m of the hand."""
    values = np.column_stack([TIME, 2 * TIME, np.full((5, 4), [3.0, 0.1, 0.2, 0.3])])
    write_table(tmp_path / "handle.mot", NAMES, TIME, values)
    file = tmp_path / "handle.xml"
    file.write_text(XML)
    return file


def test_columns_are_taken_at_the_frames_of_the_motion(files: Path) -> None:
    (load,) = read_external_loads(files, MODEL, np.array([0.0, 0.3, 0.9]))
    assert (load.body, load.axes, load.origin) == (HAND, 0, HAND)
    np.testing.assert_allclose(load.force, [[0, 0, 3], [0.3, 0.6, 3], [0.9, 1.8, 3]], atol=1e-12)
    np.testing.assert_allclose(load.point, np.tile([0.1, 0.2, 0.3], (3, 1)), atol=1e-12)
    assert not load.torque.any()


@pytest.mark.parametrize(
    ("old", "new"),
    [
        *((">handle.mot<", f">{where}<") for where in ("{folder}/handle.mot", "data/../handle.mot", ".\\handle.mot")),
        *(("appliesForce>true", f"appliesForce>{on}") for on in ("True", "1")),
        (">ground<", "><"),
        (XML, XML.replace('<OpenSimDocument Version="40000">', "").replace("</OpenSimDocument>", "")),
    ],
    ids=["whole path", "parent folder", "backslash", "True", "1", "no body", "root of the loads"],
)
def test_a_load_may_be_written_otherwise(files: Path, old: str, new: str) -> None:
    """A data file elsewhere, a flag as a script writes it, a body that is not named, a root of the loads themselves."""
    (files.parent / "data").mkdir()
    files.write_text(XML.replace(old, new.replace("{folder}", str(files.parent))))
    (load,) = read_external_loads(files, MODEL, TIME)
    assert load.axes == 0


def test_what_is_switched_off_is_left_out(files: Path) -> None:
    for on, off in (("appliesForce>true", "appliesForce>false"), ("<appliesForce>true</appliesForce>", DISABLED)):
        files.write_text(XML.replace(on, off))
        assert read_external_loads(files, MODEL, TIME) == ()


def test_components_in_another_order_are_refused(files: Path) -> None:
    data = files.with_name("handle.mot")
    text = data.read_text()
    assert "handle_vx\thandle_vy" in text
    data.write_text(text.replace("handle_vx\thandle_vy", "handle_vy\thandle_vx"))
    with raises_refusal(SolverCode.MALFORMED, naming="handle_vy, handle_vx, handle_vz"):
        read_external_loads(files, MODEL, TIME)


@pytest.mark.parametrize(
    ("old", "new", "code", "naming"),
    [
        (">hand<", ">paw<", SolverCode.UNKNOWN_NAME, "line 2: ExternalForce handle has the applied_to_body paw"),
        ("/bodyset/hand", "paw", SolverCode.UNKNOWN_NAME, "point_expressed_in_body paw"),
        ("handle_v", "lever_v", SolverCode.MALFORMED, "lever_v, and there are 0"),
        ("handle_v", "handle_", SolverCode.MALFORMED, "handle_, and there are 6"),
        (FORCE, "", SolverCode.MALFORMED, "force_identifier"),
        (FORCE, "<torque_identifier>handle_v</torque_identifier>", SolverCode.MALFORMED, "point"),
        ("<datafile>handle.mot</datafile>", "", SolverCode.MALFORMED, "<datafile>"),
        ("ExternalForce", "PrescribedForce", SolverCode.UNSUPPORTED, "PrescribedForce handle"),
        ("</objects>", "", SolverCode.UNREADABLE_FILE, "line 10"),
        ("ExternalLoads", "ForceSet", SolverCode.WRONG_DOCUMENT, "ExternalLoads"),
    ],
    ids=[
        *("unknown body", "unknown body of the point", "no columns", "six columns", "no identifier"),
        *("torque at a point", "no data file", "PrescribedForce", "no end tag", "ForceSet"),
    ],
)
def test_a_fault_in_the_file_of_loads_is_one_sentence(
    files: Path, old: str, new: str, code: SolverCode, naming: str
) -> None:
    assert old in XML
    files.write_text(XML.replace(old, new))
    with raises_refusal(code, naming):
        read_external_loads(files, MODEL, TIME)
    with raises_refusal(SolverCode.WRONG_DOCUMENT, naming="handle.mot should be OpenSim's ExternalLoads"):
        read_external_loads(files.with_name("handle.mot"), MODEL, TIME)


def test_a_gap_in_recorded_loads_is_refused_where_the_motion_meets_it(files: Path) -> None:
    time = np.arange(0.0, 1.0, 0.01)
    recorded = time[(time < 0.4) | (time > 0.6)]
    write_table(files.with_name("handle.mot"), NAMES, recorded, np.ones((len(recorded), 6)))
    with raises_refusal(SolverCode.NOT_COVERED, naming="no sample between 0.39 and 0.61 s"):
        read_external_loads(files, MODEL, np.array([0.1, 0.9]))
    assert len(read_external_loads(files, MODEL, np.array([0.1, 0.39]))) == 1
    by_hand = np.array([0.0, 0.01, 0.02, 0.03, 1.0])
    write_table(files.with_name("handle.mot"), NAMES, by_hand, np.ones((5, 6)))
    assert len(read_external_loads(files, MODEL, TIME)) == 1


def test_a_fault_in_its_data_is_one_sentence(files: Path) -> None:
    with raises_refusal(SolverCode.NOT_COVERED, naming="0 to 1.5 s") as caught:
        read_external_loads(files, MODEL, 1.5 * TIME)
    inside = 1.5 * TIME[1.5 * TIME <= 1.0]
    assert f"solve from 0 to {inside[-1]:g} s" in str(caught.value)
    assert len(read_external_loads(files, MODEL, inside)) == 1
    with raises_refusal(SolverCode.NOT_COVERED, naming="give other data"):
        read_external_loads(files, MODEL, 5.0 + TIME)
    data = files.with_name("handle.mot")
    text = data.read_text()
    data.write_text(text.replace("\n0.5\t", "\n0.2\t"))
    with raises_refusal(SolverCode.MALFORMED_TABLE, naming="handle.mot"):
        read_external_loads(files, MODEL, TIME)
    data.unlink()
    with raises_refusal(SolverCode.UNREADABLE_TABLE, naming="handle.mot"):
        read_external_loads(files, MODEL, TIME)


@pytest.mark.parametrize("value", [1e300, -1e300, 1.1e9])
@pytest.mark.parametrize("column", ["handle_vy", "handle_pz"])
def test_a_load_that_nothing_gives_is_refused_by_its_column(files: Path, value: float, column: str) -> None:
    data = files.with_suffix(".mot")
    names, table, _ = read_table(data)
    table[2, names.index(column)] = value
    write_table(data, names[1:], table[:, 0], table[:, 1:])
    with raises_refusal(SolverCode.IMPOSSIBLE_VALUE, naming=f"handle.mot should have {column} below 1e+09"):
        read_external_loads(files, MODEL, TIME)


def test_a_column_that_no_load_uses_and_times_since_1970_may_be_as_large_as_they_are(files: Path) -> None:
    """A spline through 1e300 would print a warning of NumPy, which is an error of this test."""
    data, since_1970 = files.with_suffix(".mot"), 1.7e9 + 100 * TIME
    names, table, _ = read_table(data)
    spike = np.where(TIME == 0.5, 1e300, 0.0)[:, None]
    write_table(data, [*names[1:], "emg"], since_1970, np.column_stack([table[:, 1:], spike]))
    (load,) = read_external_loads(files, MODEL, since_1970)
    np.testing.assert_allclose(load.force[:, 0], TIME, atol=1e-6)


@pytest.mark.parametrize(
    "named",
    ["C:\\lab\\P01\\handle.mot", "\\\\server\\x\\handle.mot", "/Users/a/handle.mot", "data\\handle.mot", OTHER_CASE],
)
def test_a_data_file_of_another_computer_is_taken_from_beside_the_document(files: Path, named: str) -> None:
    assert read_loads_document(files) == LoadsDocument((), (), ())
    files.write_text(MOVED.format(named))
    assert len(read_external_loads(files, MODEL, TIME)) == 1
    assert read_loads_document(files).moved == (f"{named} as handle.mot",)
    files.with_name("handle.mot").rename(files.with_name("other.mot"))
    with raises_refusal(SolverCode.UNREADABLE_TABLE, naming="handle.xml, line 10: datafile names"):
        read_external_loads(files, MODEL, TIME)


@pytest.mark.parametrize("name", ["ground", "/ground"])
def test_a_load_on_the_ground_and_an_element_that_is_not_used_are_named(files: Path, name: str) -> None:
    text = XML.replace("applied_to_body>hand", f"applied_to_body>{name}")
    kinematics = "<external_loads_model_kinematics_file>walk.mot</external_loads_model_kinematics_file>"
    files.write_text(text.replace("<datafile>", kinematics + "<data_source_name>x</data_source_name><datafile>"))
    found = read_loads_document(files)
    assert found.on_ground == ("handle",)
    assert found.unused == ("<external_loads_model_kinematics_file> walk.mot (line 10)",)


AGAIN = "<applied_to_body>ground</applied_to_body>"


@pytest.mark.parametrize(
    ("exchanged", "named"),
    [
        ({"<applied_to": "<apply>false</apply><applied_to"}, ["<apply> false"]),
        (
            {"<force_id": f"{AGAIN}<force_id", "</datafile>": "</datafile><datafile>other.mot</datafile>"},
            ["<applied_to_body> ground", "<datafile> other.mot"],
        ),
    ],
    ids=["switch", "repeated"],
)
def test_a_switch_that_is_no_property_of_a_load_and_an_element_that_repeats_one_above_are_named(
    files: Path, exchanged: dict[str, str], named: list[str]
) -> None:
    """ExternalForce has appliesForce, not apply; OpenSim 4.5 takes the first of a tag, of the loads and of one load."""
    text = XML
    for old, new in exchanged.items():
        text = text.replace(old, new, 1)
    files.write_text(text)
    assert [unused.partition(" (")[0] for unused in read_loads_document(files).unused] == named


def with_nan(files: Path, column: str, row: int, force: float) -> None:
    """The number of a column is none in a row, where the force is as given."""
    data = files.with_name("handle.mot")
    names, table, _ = read_table(data)
    table[row, 1:4] = force
    text = data.read_text().split("endheader")[0]
    rows = [[f"{value:g}" for value in line] for line in table]
    rows[row][names.index(column)] = "nan"
    data.write_text("\n".join([text + "endheader", "\t".join(names), *map("\t".join, rows)]) + "\n")


@pytest.mark.parametrize("row", [0, 2, 4])
def test_a_point_without_a_force_need_not_be_a_number(files: Path, row: int) -> None:
    with_nan(files, "handle_py", row, 0.0)
    (load,) = read_external_loads(files, MODEL, TIME)
    np.testing.assert_allclose(load.point, np.tile([0.1, 0.2, 0.3], (5, 1)), atol=1e-12)
    np.testing.assert_allclose(load.force[row], 0.0, atol=1e-12)


@pytest.mark.parametrize(("column", "force"), [("handle_py", 1.0), ("handle_vy", 0.0)])
def test_a_load_that_is_not_a_number_is_refused_with_the_remedy(files: Path, column: str, force: float) -> None:
    with_nan(files, column, 2, force)
    with raises_refusal(SolverCode.NOT_FINITE, naming="in frame 3, 0.5 s; write 0 for a force"):
        read_external_loads(files, MODEL, TIME)


@pytest.mark.parametrize("rows", [60, 13, 3])
def test_loads_in_milliseconds_are_refused(files: Path, rows: int) -> None:
    time = np.linspace(0.2, 1.4, rows)
    write_table(files.with_name("handle.mot"), NAMES, 1000 * time, np.ones((rows, 6)))
    with raises_refusal(SolverCode.TIME_UNIT, naming="handle.mot"):
        read_external_loads(files, MODEL, time)
