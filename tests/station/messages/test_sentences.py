"""Every code of the station has one sentence, which its figures fill."""

from __future__ import annotations

import enum
import importlib
import pkgutil
import re
from enum import StrEnum
from string import Formatter

import pytest

from drivers.errors import DeviceCode
from fitting.results.sentences import SENTENCES as FITTED
from solver.errors import ScalingCode
from solver.personalisation.coverage import CoverageCode
from station import messages
from station.messages.codes import TrialCode
from station.messages.message import SENTENCES, Message

MODULES = [
    importlib.import_module(f"station.messages.{module.name}") for module in pkgutil.iter_modules(messages.__path__)
]
ENUMERATIONS: list[type[StrEnum]] = [
    value
    for module in MODULES
    for value in vars(module).values()
    if isinstance(value, enum.EnumMeta) and value.__module__ == module.__name__
]
CODES = [code for enumeration in (*ENUMERATIONS, CoverageCode, ScalingCode) for code in enumeration]


def test_codes_are_unique_and_every_code_has_a_sentence() -> None:
    assert len({code.value for code in CODES}) == len(CODES)
    assert set(SENTENCES) == set(CODES)


@pytest.mark.parametrize("code", CODES)
def test_every_sentence_is_rendered_from_its_figures(code: StrEnum) -> None:
    fields = [(name, spec) for _, name, spec, _ in Formatter().parse(SENTENCES[code]) if name]
    figures: dict[str, float | str] = {name: 2.0 if spec else "text" for name, spec in fields}
    sentence = str(Message(code, figures))
    assert sentence and "{" not in sentence and "\n" not in sentence


def test_no_sentence_counts_one_thing_in_the_plural() -> None:
    templates = [*SENTENCES.values(), *("".join(clauses) for clauses in FITTED.values())]
    assert [text for text in templates if re.search(r"\{(\w+s)(:\.0f)?\} ([\w-]+ )*\1\b", text)] == []


def test_a_device_s_error_is_among_the_codes_of_its_message() -> None:
    lost = Message(TrialCode.DEVICE_LOST, {"text": "QTM went silent", "code": DeviceCode.LOST.value})
    assert lost.codes == ("device_lost", DeviceCode.LOST) and Message(TrialCode.CANCELLED).codes == ("cancelled",)
