"""What a fit prints of a cuff that was pulled in several directions, and an assessment of its intervals."""

import io
from collections.abc import Callable
from dataclasses import replace
from functools import partial

import numpy as np
import pytest
from rich.console import Console

from documents.interval import UNBROKEN
from fitting.cuffs.cuff_fit import CuffFit, SessionFit, TrialFit
from fitting.cuffs.wearable_cuff import Cuff
from fitting.results.codes import NoteCode, Verdict
from fitting.results.sentences import Note
from fitting.results.trial_codes import TensorCode, TrialNoteCode
from fitting.spatial.tensors import Tensor, Tensors
from fitting.uncertainty import Estimate
from solver.suit.assessment import UncertaintySummary
from solver.suit.decision import DecisionRule
from solver.suit.quantity import Quantity
from station.cuff_text import of_cuff
from station.folded_table import FoldedTable
from station.tables import assessment_table, print_cuffs
from tests.station.assessment.test_findings import assessment, curve

PLANE = Note(TensorCode.ONE_PLANE, {"quantity": "stiffness", "test": "static", "directions": 3, "missing": "(0, 0, 1)"})
NO_ROPE = Note(TensorCode.NO_ROPE, {"quantity": "damping", "test": "dynamic"})
NO_RESULT = (None, None, None, (Verdict.NO_STATIC,), np.zeros((3, 3)))
ANOTHER_LINE = Note(TrialNoteCode.ANOTHER_LINE, {"angle_deg": 30.0})


def shown(printed: Callable[[Console], None], width: int = 400) -> str:
    console = Console(file=io.StringIO(), width=width, legacy_windows=False)
    with console.capture() as capture:
        printed(console)
    return capture.get()


def _printed(tensors: Tensors, *notes: Note) -> str:
    trial = TrialFit("static-2", "s", "static", 2, 2, "used", notes=notes)
    fit = CuffFit("hand", "arm", "1", *NO_RESULT, trials=(trial,), tensors=tensors)
    return shown(partial(print_cuffs, SessionFit({"hand": {"1": fit}}, ())))


def test_principal_values_are_printed_with_their_half_widths_and_axes() -> None:
    tensor = Tensor(np.diag([1000.0, 2000.0, 3000.0]), 25.0 * np.eye(6), 2.0, 5)
    assert "stiffness in three dimensions [N/m]: 1000 ± 10 along (1.00, 0.00, 0.00); 2000" in _printed(
        Tensors(tensor, None, None, NO_ROPE)
    )


def test_too_few_directions_have_a_reason_and_a_single_direction_has_none() -> None:
    refused = Tensors(None, None, PLANE, NO_ROPE)
    assert str(PLANE) in _printed(refused, ANOTHER_LINE)
    assert str(PLANE) not in _printed(refused)


def test_a_lag_that_no_bounce_calibrated_is_printed_once_for_all_cuffs() -> None:
    note = Note(NoteCode.NOT_CALIBRATED, {"lag_s": 0.0, "lag_sd_s": 5e-4, "gain_sd": 0.0})
    fits = {name: {"1": CuffFit(name, "arm", "1", *NO_RESULT, notes=(note,))} for name in ("hand", "tube")}
    assert shown(partial(print_cuffs, SessionFit(fits, ()))).count(str(note)) == 1


@pytest.mark.parametrize("sources", [(), ("fit",), ("fit", "motion")])
def test_the_caption_of_an_assessment_names_what_was_drawn(sources: tuple[str, ...]) -> None:
    drawn = UncertaintySummary(50, 50, 20, {}, sources, (0.9, 0.98), {}, {}, DecisionRule()) if sources else None
    caption = str(assessment_table(assessment(curve("hand", 0.85), uncertainty=drawn)).caption)
    found = "fit" in caption, "motion" in caption, "interval" in caption
    assert found == ("fit" in sources, "motion" in sources, bool(sources))


def test_the_caption_of_an_assessment_explains_the_terms_of_its_headings() -> None:
    table = assessment_table(assessment(curve("hand", 0.85)))
    headings = " ".join(str(column.header) for column in table.columns)
    for term in ("effort", "permissible error"):
        assert term in headings and f"{term}: " in str(table.caption)


def test_an_interval_of_an_assessment_has_both_ends_and_no_more_decimals_than_the_report() -> None:
    plain = curve("hand", 0.9)
    figures = {
        "at_reference": Quantity(0.898341, (0.898223, 0.898408)),
        "rest_length": Quantity(0.695, (0.581, 0.731)),
        "permissible_error": Quantity(0.0593),
    }
    row = list(assessment_table(assessment(replace(plain, figures={**plain.figures, **figures}))).columns)
    cells = [list(column.cells)[-1] for column in row]
    assert [str(cell).replace(UNBROKEN, " ") for cell in cells[2:4]] == ["0.898", "0.695 (0.581 to 0.731)"]
    assert cells[5] == "5.9"


def test_the_conditions_of_an_assessment_are_not_broken_on_a_terminal_of_80_columns() -> None:
    plain = curve("hand", 0.9, "visco_elastic")
    wide = {name: Quantity(0.695, (0.581, 0.731)) for name in ("at_reference", "rest_length", "lowest_cost")}
    table = assessment_table(assessment(replace(plain, figures={**plain.figures, **wide})))
    assert "visco-elastic" in shown(lambda console: console.print(table), 80)


def test_a_narrow_terminal_does_not_shorten_a_number_or_a_key() -> None:
    table = FoldedTable("stream", "samples", "key")
    table.add_row("/force", "92002", "protocol.step_masses_kg")
    lines = shown(lambda console: console.print(table), 24).splitlines()
    columns = zip(*(line.split("│")[1:-1] for line in lines if line.startswith("│")), strict=True)
    assert ["".join(map(str.strip, cells)) for cells in columns] == ["/force", "92002", "protocol.step_masses_kg"]


def test_a_figure_that_is_not_identified_or_was_entered_by_hand_is_marked() -> None:
    wide, known = Estimate(210.0, 120.0, (-25.0, 445.0)), Estimate(8520.0, 10.0, (8500.0, 8540.0))
    fit = CuffFit("hand", "arm", "1", known, wide, None, (Verdict.LAG,), np.zeros((3, 3)), {})
    assert of_cuff(fit, "damping", "210 ± 240") == "not identified: 210 ± 240"
    assert of_cuff(fit, "stiffness", "8520 ± 20") == "8520 ± 20"
    assert of_cuff(fit, "migration", "not identified") == "not identified"
    cuff = Cuff("hand", stiffness=known, damping=210.0)
    assert of_cuff(cuff, "damping", "210") == "210 (given by hand)"
    assert of_cuff(cuff, "stiffness", "8520 ± 20") == "8520 ± 20"
