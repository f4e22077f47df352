"""The page after an action: it shows the new state also if the button that was pressed is gone."""

import ast
import asyncio
import gc
import math
import re
from collections.abc import Awaitable
from pathlib import Path
from typing import Any

import nicegui
import pytest
from nicegui import Client, ui
from nicegui.page import page

from station.console.actions import _unless_late
from station.console.charts import DISPLACEMENT_AXIS, ELEVATION_AXIS, force_over_motion
from station.console.kept_form import keep_form
from station.console.live_view import best_text, delivery_text, most_active, rest_length_text, share_text
from station.console.page import HERE, _Page
from station.console.running_view import _over_time
from station.console.setup_view import _parse_masses
from station.live.published import LiveBest, LiveDelivery, LiveUpdate
from station.messages.session_messages import CommandCode
from station.session.open_session import CommandRefused
from tests.house.sources import nodes_of
from tests.refusals import raises_refusal
from tests.station.console.live_source import live_setup

SELECTED_BY_SCRIPTS = {"body", "live-numbers", "mark-button", "note", "session", "sessions"}
"""Classes without a rule of their own: the page's scripts or the tests find elements by them."""


@pytest.mark.parametrize(
    "chart",
    [force_over_motion([]), _over_time(DISPLACEMENT_AXIS), _over_time(ELEVATION_AXIS)],
    ids=["path", "over time", "wearer"],
)
def test_every_axis_of_a_chart_has_a_name_with_its_unit_and_labels_that_never_run_into_each_other(
    chart: dict[str, Any],
) -> None:
    assert chart["xAxis"]["axisLabel"]["hideOverlap"]
    beside = chart["yAxis"] if isinstance(chart["yAxis"], list) else [chart["yAxis"]]
    for axis in (chart["xAxis"], *beside):
        assert axis["name"].endswith(("[s]", "[N]", "[mm]", "[deg]"))


class Field:
    """An empty field, and what is called when its content changes."""

    def __init__(self) -> None:
        self.value, self.observers = "", list[Any]()

    def on_value_change(self, observer: Any) -> None:
        self.observers.append(observer)


def test_what_is_entered_before_the_tab_has_answered_stands_and_is_kept(monkeypatch: pytest.MonkeyPatch) -> None:
    subject, operator = Field(), Field()
    started: list[Any] = []
    stored: list[str] = []

    async def kept() -> dict[str, str]:
        subject.value = "P07"
        return {"subject": "P01", "operator": "ab"}

    def run_javascript(code: str, **_: Any) -> Awaitable[dict[str, str]] | None:
        if code.startswith("return"):
            return kept()
        stored.append(code)
        return None

    monkeypatch.setattr(ui, "timer", lambda _, work, **__: started.append(work))
    monkeypatch.setattr(ui, "run_javascript", run_javascript)
    keep_form("setup", {"subject": subject, "operator": operator})  # type: ignore[dict-item]
    asyncio.run(started[0]())
    assert (subject.value, operator.value) == ("P07", "ab")
    assert '"subject": "P07"' in stored[-1] and len(subject.observers) == len(operator.observers) == 1


@pytest.mark.parametrize("is_deleted_first", [True, False])
def test_an_action_that_deletes_its_button_still_reaches_the_page(monkeypatch, is_deleted_first: bool) -> None:
    reached: list[Client] = []
    client = Client(page("/"), request=None)
    shown: Any = _Page.__new__(_Page)  # without its elements: they need a session
    shown._client = client
    with client:
        shown._form = ui.column()
    monkeypatch.setattr(shown, "_refuse", lambda _: None)
    monkeypatch.setattr(shown, "_tick", lambda: reached.append(ui.context.client))

    async def press() -> None:
        with client, ui.row() as view:
            pass
        inside = view.default_slot

        def delete() -> None:
            nonlocal view
            view.delete()
            del view
            gc.collect()

        async def act() -> None:
            if not is_deleted_first:
                delete()
            reached.append(ui.context.client)

        def act_after_deletion() -> Awaitable[None]:
            delete()
            reached.append(ui.context.client)
            return act()

        with inside:
            await shown.run(act_after_deletion if is_deleted_first else act)

    asyncio.run(press())
    assert reached and set(reached) == {client}


@pytest.mark.parametrize("pressed_ms", [0, math.nan, math.inf, -math.inf, None, "soon", [1], {}])
def test_a_press_without_a_time_and_one_of_long_ago_are_not_executed(pressed_ms: object) -> None:
    pressed: list[str] = []
    code = CommandCode.PRESSED_LATE if pressed_ms == 0 else CommandCode.PRESS_UNDATED
    with raises_refusal(code, kind=CommandRefused):
        _unless_late("Begin", pressed_ms, lambda: pressed.append("Begin"))
    assert not pressed


@pytest.mark.parametrize(
    "typed", ["1.53 2 0.5", "1,53 2 0,5", "1.53, 2, 0.5", "1,53; 2; 0,5", "1,53;2;0,5", "1,53, 2, 0,5,"]
)
def test_load_steps_are_taken_with_a_decimal_point_or_comma(typed: str) -> None:
    assert _parse_masses(typed) == (1.53, 2.0, 0.5)


@pytest.mark.parametrize("typed", ["1,53,2", "1.5 kg", "1.5.3"])
def test_an_ambiguous_number_is_refused(typed: str) -> None:
    with raises_refusal(CommandCode.MASSES_NOT_NUMBERS, kind=CommandRefused):
        _parse_masses(typed)


# Figures in the sentences of the live page.


@pytest.mark.parametrize(("share", "figure"), [(1.0, "100 %"), (0.914, "91 %"), (0.0, "0 %"), (math.nan, "–")])
def test_an_effort_is_a_share_of_that_with_a_slack_cord(share: float, figure: str) -> None:
    assert share_text(share) == figure


@pytest.mark.parametrize(
    ("best", "figures"),
    [
        (LiveBest(0.708, 0.012, 0.912, 4), ("0.71 m ± 0.01", "9 % less")),
        (LiveBest(0.708, math.nan, 1.03, 1), ("0.71 m,", "3 % more")),
    ],
)
def test_the_best_rest_length_has_its_spread_and_its_effort(best: LiveBest, figures: tuple[str, ...]) -> None:
    assert all(figure in best_text(best) for figure in figures)


def test_the_largest_activations_come_first_and_unsolved_ones_are_left_out() -> None:
    text = most_active(("a", "b_c", "d"), (0.12, 0.5, math.nan))
    assert text.endswith("b c 50 %, a 12 %")
    assert "%" not in most_active(("a",), (math.nan,))


def test_frames_left_out_and_updates_not_shown_are_counted() -> None:
    delivery = LiveDelivery(0.0, 0.17, 0.021, 50, 7, 1, 98.6, not_shown=3)
    text = delivery_text(live_setup(), LiveUpdate(None, delivery), is_over=False)
    for figures in ("99 of 100 frames", "7 frames left out", "21 ms", "3 updates"):
        assert figures in text


def test_a_rest_length_has_millimetres() -> None:
    assert "0.705 m" in rest_length_text(0.705) and not rest_length_text(math.nan)


def test_every_class_of_the_page_has_a_rule() -> None:
    """No Tailwind compiles in the browser what the style sheets lack."""
    calls = [node for path in HERE.glob("*.py") for node in nodes_of(path) if isinstance(node, ast.Call)]
    found = [call for call in calls if isinstance(call.func, ast.Attribute) and call.func.attr == "classes"]
    given = [argument for call in found for argument in (*call.args, *(keyword.value for keyword in call.keywords))]
    texts = [part.value for argument in given for part in ast.walk(argument) if isinstance(part, ast.Constant)]
    used = {name for text in texts if isinstance(text, str) for name in text.split()}
    sheets = [*HERE.glob("*.css"), *Path(nicegui.__file__).parent.glob("static/*.css")]
    rules = re.findall(r"\.((?:[\w-]|\\[:/])+)", "".join(path.read_text(encoding="utf-8") for path in sheets))
    assert len(used) > 80
    assert used - {rule.replace("\\", "") for rule in rules} == SELECTED_BY_SCRIPTS
