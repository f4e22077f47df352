"""Every code of the station has one sentence, which its figures fill."""

import enum
import importlib
import pkgutil
import re
from pathlib import Path
from string import Formatter

import pytest

from documents.message import Code, Message, because
from drivers.errors import DeviceCode, DeviceLost
from solver.errors import CoverageCode, ScalingCode
from station import messages
from station.messages.bench_messages import TrialCode
from tests.fitting.results.test_sentences import CODES as FITTED

MODULES = [
    importlib.import_module(f"station.messages.{module.name}") for module in pkgutil.iter_modules(messages.__path__)
]
ENUMERATIONS: list[type[Code]] = [
    value
    for module in MODULES
    for value in vars(module).values()
    if isinstance(value, enum.EnumMeta) and value.__module__ == module.__name__
]
CODES = [code for enumeration in (*ENUMERATIONS, CoverageCode, ScalingCode) for code in enumeration]


def test_codes_are_unique() -> None:
    assert len({code.value for code in CODES}) == len(CODES)


def test_no_code_of_a_released_version_is_gone() -> None:
    """Most follow from the name of their member, which may not be changed for that reason."""
    released = (Path(__file__).parent / "codes_of_0.2.0.txt").read_text(encoding="utf-8").split()
    assert set(released) - {code.value for code in (*CODES, *FITTED)} == set()


@pytest.mark.parametrize("code", CODES)
def test_every_code_has_a_sentence_that_its_figures_fill(code: Code) -> None:
    fields = [(name, spec) for clause in code.clauses for _, name, spec, _ in Formatter().parse(clause) if name]
    figures: dict[str, float | str] = {name: 2.0 if spec else "text" for name, spec in fields}
    sentence = str(Message(code, figures))
    assert sentence and "{" not in sentence and "\n" not in sentence


def test_no_sentence_counts_one_thing_in_the_plural() -> None:
    assert [
        text
        for text in map("".join, (code.clauses for code in (*CODES, *FITTED)))
        if re.search(r"\{(\w+s)(:\.0f)?\} ([\w-]+ )*\1\b", text)
    ] == []


def test_a_device_s_error_is_among_the_codes_of_its_message() -> None:
    lost = Message(TrialCode.DEVICE_LOST, because(DeviceLost("QTM went silent")))
    assert lost.codes == ("device_lost", DeviceCode.LOST) and Message(TrialCode.CANCELLED).codes == ("cancelled",)
