"""The suited model as a file: from the bundled table or a user's .osim, and a sentence where it cannot be."""

import xml.etree.ElementTree as Xml
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from solver.bundled import bundled_model, simulate_arm_raise
from solver.errors import SolverCode
from solver.motion import differentiate
from solver.osim.document import read_document
from solver.osim.model_writer import osim_document
from solver.osim.suited import add_suit, read_suited
from solver.redundancy.motion_solution import LoadedMotion
from solver.suit.cord import Condition, SuitScenario
from solver.suit.scenarios import prepare_suited_motion, solve_scenarios
from solver.suit.suit import BUNDLED_SUIT, read_suit
from station.assessment.assessment_inputs import InputError, read_cuffs_to_wear, worn_cuffs
from station.assessment.export_model import SuitToExport, write_suited_model
from station.exit_code import WRONG_USAGE
from station.messages.assessment_messages import InputCode
from station.sources import resolve_model
from tests.refusals import raises_refusal
from tests.station.assessment.test_assess import write_cuffs
from tests.station.command import assert_one_sentence

PARTS = ("waist", "arm")


def written(worn: SuitToExport, folder: Path) -> Xml.Element:
    write_suited_model(worn, folder / "out" / "suited.osim")
    return Xml.parse(folder / "out" / "suited.osim").getroot()  # noqa: S314  (of our own making)


def number(root: Xml.Element, path: str) -> float:
    return float(str(root.findtext(f".//{path}")).split()[0])


def test_cuffs_are_welded_on_or_on_bushings_with_their_migration_in_the_cord(tmp_path: Path) -> None:
    root = written(SuitToExport(rest_length=0.7), tmp_path)
    assert [body.get("name") for body in root.iter("Body")][-3:] == ["waist_cuff", "shoulder_cuff", "arm_cuff"]
    assert [number(root, f"Body[@name='{part}_cuff']/mass") for part in ("waist", "shoulder", "arm")] == [0.2] * 3
    assert number(root, "PathSpring/resting_length") == 0.7
    assert root.find(".//BushingForce") is None
    root = written(SuitToExport(cuffs=write_cuffs(tmp_path / "cuffs.json"), cuff="elbow"), tmp_path)
    stiffness = [number(root, f"BushingForce[@name='{part}_cuff_bushing']/translational_stiffness") for part in PARTS]
    assert stiffness == [2140.0, 2530.0]
    with raises_refusal(SolverCode.UNSUPPORTED, "without the suit"):  # where another would be added
        resolve_model(str(tmp_path / "out" / "suited.osim"))
    assert number(root, "PathSpring/resting_length") == pytest.approx(0.74 + 0.012 + 0.022)


def test_a_users_own_model_keeps_all_it_has(tmp_path: Path) -> None:
    own = osim_document(bundled_model())
    model = own[0]
    model.insert(0, Xml.Comment("scaled by Anna"))
    Xml.SubElement(model, "credits").text = "Anna"
    Xml.ElementTree(own).write(tmp_path / "own.osim", encoding="utf-8")
    root = written(SuitToExport(model=str(tmp_path / "own.osim")), tmp_path)
    text = (tmp_path / "out" / "suited.osim").read_text(encoding="utf-8")
    assert "<!--scaled by Anna-->" in text
    assert root.findtext("Model/credits") == "Anna"
    assert len(list(root.iter("Body"))) == len(list(own.iter("Body"))) + 3


RIGID = read_suit(), SuitScenario("rigid", None, None, np.array([0.7]))


@pytest.mark.parametrize(
    ("change", "naming"),
    [
        pytest.param(lambda root: add_suit(root, bundled_model(), *RIGID), "", id="wears a suit"),
        pytest.param(lambda root: root.set("Version", "30000"), "", id="layout of OpenSim 3"),
        pytest.param(lambda root: next(root.iter("ForceSet")).set("file", "a.xml"), "one file", id="several files"),
    ],
)
def test_the_suit_is_not_added_where_it_cannot_be_written(change: Callable[[Xml.Element], None], naming: str) -> None:
    change(root := osim_document(bundled_model()))
    with raises_refusal(SolverCode.SUIT_NOT_WRITABLE, naming):
        add_suit(root, bundled_model(), *RIGID)


@pytest.mark.parametrize(
    ("worn", "code"),
    [
        ({"condition": "both"}, InputCode.CONDITION_WITHOUT_CUFFS),
        ({"cuff": "hand"}, InputCode.NO_CUFFS_FILE),
        ({"cuffs": "cuffs.json"}, InputCode.ONE_ARM_CUFF),
        ({"cuffs": "cuffs.json", "cuff": "knee"}, InputCode.UNKNOWN_CUFF),
    ],
)
def test_the_cuffs_of_the_suit_must_be_unambiguous(tmp_path: Path, worn: dict[str, str], code: InputCode) -> None:
    write_cuffs(tmp_path / "cuffs.json")
    named = {key: tmp_path / value if key == "cuffs" else value for key, value in worn.items()}
    with raises_refusal(code, kind=InputError) as caught:
        write_suited_model(SuitToExport(**named), tmp_path / "out.osim")  # type: ignore[arg-type]
    assert caught.value.exit_code == WRONG_USAGE
    assert not (tmp_path / "out.osim").exists()


@pytest.mark.parametrize(
    ("old", "new", "naming"),
    [
        ("damping_n_s_per_m = 0.0", "damping_n_s_per_m = 3.0", "3 N s/m"),
        ('[masses.arm]\nbody = "humerus"', '[masses.arm]\nbody = "ulna"', "masses.arm"),
    ],
)
def test_a_suit_that_opensim_cannot_have_is_refused(tmp_path: Path, old: str, new: str, naming: str) -> None:
    text = BUNDLED_SUIT.read_text(encoding="utf-8")
    assert old in text
    (tmp_path / "suit.toml").write_text(text.replace(old, new), encoding="utf-8")
    with raises_refusal(SolverCode.SUIT_NOT_WRITABLE, naming):
        write_suited_model(SuitToExport(suit=tmp_path / "suit.toml"), tmp_path / "out.osim")


def test_the_verb_prints_the_path_and_needs_one(station, tmp_path: Path) -> None:
    output = tmp_path / "suited.osim"
    ran = station("export", "--osim", "--output", output, "--rest-length-m", "0.7")
    assert (ran.code, ran.out.strip()) == (0, str(output))
    assert output.is_file()
    assert_one_sentence(station("export", "--osim"), 2, "lacks --output")
    assert_one_sentence(station("export", "--osim", "--output", output, "--condition", "both"), 2, "needs cuffs")


@pytest.mark.parametrize("condition", ["rigid", "visco_elastic"])
def test_rmr_of_the_suited_model_finds_what_an_assessment_does(station, tmp_path: Path, condition: Condition) -> None:
    cuffs = write_cuffs(tmp_path / "cuffs.json")
    out, file = tmp_path / "suited.csv", tmp_path / "suited.osim"
    chosen = ("--cuffs", cuffs, "--cuff", "hand", "--condition", condition)
    assert station("export", "--osim", "--output", file, *chosen).code == 0
    ran = station("rmr", "--model", file, "--every", 60, "--output", out)
    assert ran.code == 0, ran.err
    table = pd.read_csv(out, comment="#")
    motion = differentiate(simulate_arm_raise(bundled_model()))
    suit = read_suit()
    worn = prepare_suited_motion(LoadedMotion(bundled_model(), motion), suit, 60)
    waist, arm = (
        (cuff if condition != "rigid" else None) for cuff in worn_cuffs(read_cuffs_to_wear(cuffs, ("hand",)), ("hand",))
    )
    wearing = SuitScenario(condition, waist, arm, np.array([suit.reference_rest_length]))
    slack, (effort,) = solve_scenarios(worn, [wearing])
    names = list(bundled_model().muscle_names)
    np.testing.assert_allclose(table[names].to_numpy(), effort.activations[0], atol=1e-7)
    assert np.abs(effort.activations[0] - slack.activations[0]).max() > 0.01, "the suit does something"
    assert "# suit=cord 500 N/m, resting length with migration 0.74 m, waist cuff " in out.read_text()


@pytest.mark.oracle
def test_a_suited_model_that_opensim_saved_again_is_the_same(tmp_path: Path) -> None:
    opensim = pytest.importorskip("opensim", reason="needs OpenSim: install the extra oracle")
    ours, again = tmp_path / "ours.osim", tmp_path / "again.osim"
    write_suited_model(SuitToExport(cuffs=write_cuffs(tmp_path / "cuffs.json"), cuff="hand"), ours)
    model = opensim.Model(str(ours))
    model.finalizeConnections()
    model.printToXML(str(again))
    one, other = (read_suited(read_document(path)) for path in (ours, again))
    assert one is not None and other is not None
    for part in ("waist", "shoulder", "arm"):
        found, expected = getattr(other.suit, part), getattr(one.suit, part)
        assert found.body == expected.body
        np.testing.assert_allclose(found.location, expected.location, atol=1e-12)
    for found, expected in ((other.waist, one.waist), (other.arm, one.arm)):
        assert found is not None and expected is not None
        assert (found.stiffness, found.damping) == (expected.stiffness, expected.damping)
    assert other.suit.reference_rest_length == pytest.approx(one.suit.reference_rest_length)
    assert [body.name for body in other.bare.bodies] == [body.name for body in bundled_model().bodies]


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("<location>0.0 0.0 0.0</location>", "<location>0.1 0.0 0.0</location>", "does not run straight through"),
        ("<dissipation>0.0<", "<dissipation>0.5<", "has a dissipation"),
        ("8520.0 8520.0 8520.0", "8520.0 8520.0 1.0", "differs between axes"),
    ],
)
def test_a_suit_of_another_structure_is_refused(station, tmp_path: Path, old: str, new: str, words: str) -> None:
    file = tmp_path / "suited.osim"
    write_suited_model(SuitToExport(cuffs=write_cuffs(tmp_path / "cuffs.json"), cuff="hand"), file)
    text = file.read_text(encoding="utf-8")
    at = text.index(old, text.index("<PathSpring") if old.startswith("<") else 0)
    file.write_text(text[:at] + text[at:].replace(old, new, 1), encoding="utf-8")
    assert_one_sentence(station("rmr", "--model", file, "--output", tmp_path / "out.csv"), 1, words)
