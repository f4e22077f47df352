"""Form of the wearer's data that no marker shows: in the set-up, and in a dialog of the open session."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from nicegui import ui
from nicegui.elements.mixins.value_element import ValueElement

from station.console.actions import Actions
from station.kinematics.marker_sets import published_sets
from station.messages.session_messages import CommandCode
from station.session.controller import SessionController
from station.session.open_session import CommandRefused
from station.subject.subject_file import Cord, Subject

UNKNOWN = "not known"
AXES = ("x", "y", "z")
NO_CUFF, MODEL_MARKERS = "rigid, or not known", "those of the model"


@dataclass(frozen=True)
class _Quantity:
    """A quantity that may be unknown, with the range in which a typed number is credible."""

    name: str
    unit: str
    lowest: float
    highest: float


MASS = _Quantity("body mass", "kg", 20, 300)
LOAD = _Quantity("load in the hand", "kg", 0, 50)
REST_LENGTH = _Quantity("rest length of the cord", "m", 0.1, 3)


class WearerForm:
    """fields are by name, to be kept while the page reconnects."""

    def __init__(self, cuffs: Sequence[str], marker_sets: Sequence[str]) -> None:
        self._labels: Mapping[str, str] = {}  # of markers, which only subject.toml names
        with ui.element("div").classes("wearer").mark("wearer"):
            self._mass = _number_field(MASS, "body-mass")
            self._load = _number_field(LOAD, "hand-load")
            self._rest = _number_field(REST_LENGTH, "rest-length")
            self._cuff = ui.select({"": NO_CUFF} | {name: name for name in cuffs}, label="Cuff under the tight cord")
            self._vertical = ui.select(list(AXES), label="Vertical axis of the laboratory")
            self._sets = {"": MODEL_MARKERS} | {name: name for name in marker_sets}
            self._set = ui.select(self._sets, label="Marker set")
            self._set.props("use-input new-value-mode=add-unique input-debounce=0").mark("marker-set")
        self.fields: dict[str, ValueElement[Any]] = {
            "mass": self._mass,
            "load": self._load,
            "rest": self._rest,
            "cuff": self._cuff,
            "vertical": self._vertical,
            "set": self._set,
        }

    def show(self, wearer: Subject) -> None:
        cord = wearer.cord or Cord()
        self._labels = wearer.markers
        self.show_mass(wearer.mass_kg)
        self._load.value = _text(wearer.hand_load_kg)
        self._rest.value = _text(cord.rest_length_m)
        self._cuff.value = cord.cuff if cord.cuff in self._cuff.options else ""
        self._vertical.value = wearer.vertical
        if wearer.marker_set not in self._sets:
            self._sets[wearer.marker_set] = wearer.marker_set
            self._set.set_options(self._sets)
        self._set.value = wearer.marker_set

    def show_mass(self, mass_kg: float | None) -> None:
        self._mass.value = _text(mass_kg)

    @property
    def wearer(self) -> Subject:
        """Raises CommandRefused for a number that is not credible."""
        rest, cuff = _number(REST_LENGTH, self._rest), self._cuff.value or None
        return Subject(
            mass_kg=_number(MASS, self._mass),
            hand_load_kg=_number(LOAD, self._load) or 0.0,
            vertical=self._vertical.value,
            marker_set=self._set.value or "",
            markers=dict(self._labels),
            cord=Cord(rest_length_m=rest, cuff=cuff) if rest is not None or cuff is not None else None,
        )


def offer_wearer(controller: SessionController, actions: Actions) -> None:
    """Add the button that opens the dialog of the wearer, if the configuration has one."""
    if controller.session.config.body is not None:
        actions.add("Wearer", "w", lambda: _open_wearer(controller, actions), mark="wearer-dialog")


def _open_wearer(controller: SessionController, actions: Actions) -> None:
    """Raises SubjectError for a damaged subject.toml."""
    wearer = controller.session.wearer
    with ui.dialog(value=True) as dialog, ui.card().classes("w-full max-w-none").style("width: min(900px, 94vw)"):
        dialog.props('aria-label="Wearer"')
        ui.label("Wearer").classes("heading")
        form = WearerForm(tuple(controller.session.config.cuffs), published_sets())
        form.show(wearer)

        fault = ui.label().classes("text-lg bad").props("role=alert")

        async def save() -> None:
            try:
                declared = form.wearer
            except CommandRefused as refused:  # the fields keep their content
                fault.text = str(refused)
                return
            dialog.close()
            await actions.run(lambda: controller.session.declare_wearer(declared))

        with ui.row():
            ui.button("Save", on_click=save).props("unelevated color=primary")
            ui.button("Close", on_click=dialog.close).props("outline")
    dialog.on("hide", dialog.delete)


def parse_number(text: str) -> float:
    """A number with a decimal point or comma. Raises ValueError."""
    return float(text.strip().replace(",", "."))


def _number_field(quantity: _Quantity, mark: str) -> ui.input:
    label = f"{quantity.name[0].upper()}{quantity.name[1:]} [{quantity.unit}]"
    return ui.input(label, placeholder=UNKNOWN).props("stack-label inputmode=decimal").mark(mark)


def _text(value: float | None) -> str:
    return "" if value is None else f"{value:g}"


def _number(quantity: _Quantity, field: ui.input) -> float | None:
    text = str(field.value or "").strip()
    if not text:
        return None
    try:
        value = parse_number(text)
    except ValueError:
        value = float("nan")
    if not quantity.lowest <= value <= quantity.highest:
        figures = {"quantity": quantity.name, "text": repr(text), "unit": quantity.unit}
        limits = {"lowest": quantity.lowest, "highest": quantity.highest}
        raise CommandRefused.of(CommandCode.WRONG_QUANTITY, **figures, **limits)
    return value
