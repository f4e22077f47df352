"""Output of a planned study: plan.json, the station's configuration with its protocol, and a table."""

from __future__ import annotations

import json
import re
from collections.abc import Sequence
from pathlib import Path
from typing import Literal

from pydantic import BaseModel, ConfigDict, Field

from documents.plain_data import parse_toml
from documents.regular_file import read_regular
from station.config import parse_config
from station.folded_table import FoldedTable
from station.messages.message import Message
from station.messages.study_codes import PlanCode
from station.study.designs import DesignOutcome, StudyDesign
from station.study.plan_file import StudyPlan
from station.study.sessions import StudyError
from station.study.units import SHOWN
from station.whole_file import write_whole

PLAN_FILE, CONFIG_FILE = "plan.json", "station.toml"
FORMAT: Literal[1] = 1
SECTION = re.compile(r"^\[protocol\][^\n]*\n(?:(?!\[).*\n?)*?(?=^(?:# )?\[|\Z)", re.M)
SHOWN_DESIGNS = 8


class _Entry(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)


class DesignEntry(_Entry):
    """One design, in SI. Standard errors are those of one donning, from the noise of its trials."""

    outcome: DesignOutcome
    volunteers: int
    donnings: int
    repeats: int
    step_masses_kg: list[float]
    swing_frequency_hz: float
    stiffness_error_n_per_m: float
    damping_error_n_s_per_m: float
    migration_error_m: float
    difference_error: float = Field(description="standard error of the mean difference of the cuffs")
    power: float
    session_minutes: float
    total_hours: float


class StudyPlanDocument(_Entry):
    """plan.json: the designs of a study, the recommended one first, and the plan that they were computed from."""

    format: Literal[1]
    plan: StudyPlan
    designs: list[DesignEntry]


def write_plan(folder: Path, plan: StudyPlan, designs: Sequence[StudyDesign]) -> Path:
    """Write plan.json into the folder."""
    document = StudyPlanDocument(format=FORMAT, plan=plan, designs=[_entry(design) for design in designs])
    write_whole(folder / PLAN_FILE, json.dumps(document.model_dump(mode="json"), indent=1, allow_nan=False) + "\n")
    return folder / PLAN_FILE


def planned_config(config: Path, plan: StudyPlan, design: StudyDesign) -> str:
    """The station's configuration with the protocol of the design. Raises StudyError and ConfigError."""
    text = read_regular(config, 2**20).decode("utf-8-sig").replace("\r\n", "\n")
    if not SECTION.search(text):
        raise StudyError(Message(PlanCode.NO_PROTOCOL, {"path": str(config)}))
    masses = ", ".join(f"{mass:g}" for mass in design.step_masses_kg)
    section = (
        f"[protocol]                        # planned: {design.volunteers} volunteers, "
        f"{design.donnings} donnings of each cuff, swing at {design.swing_frequency_hz:g} Hz\n"
        f"repeats = {design.repeats}\n"
        f"pause_s = {plan.time.pause_s:g}\n"
        f"hold_s = {plan.time.hold_s:g}\n"
        f"swing_s = {plan.time.swing_s:g}\n"
        f"step_masses_kg = [{masses}]\n\n"
    )
    planned = SECTION.sub(lambda _: section, text, count=1)
    parse_config(parse_toml(planned), str(config))
    return planned


def design_table(plan: StudyPlan, designs: Sequence[StudyDesign]) -> FoldedTable:
    """The first designs; the precision is that of the quantity to be detected, of one donning."""
    detect = plan.detect
    scale, unit = SHOWN[detect.quantity]
    title = f"Designs to detect a difference of {scale * detect.difference:g} {unit} in {detect.quantity}"
    names = ("volunteers", "donnings", "repeats", "weights [kg]", "swing [Hz]", f"noise [{unit}]", "power")
    table = FoldedTable(*names, "session [min]", "total [h]", title=title, title_justify="left")
    for design in designs[:SHOWN_DESIGNS]:
        table.add_row(
            str(design.volunteers),
            str(design.donnings),
            str(design.repeats),
            " + ".join(f"{mass:g}" for mass in design.step_masses_kg),
            f"{design.swing_frequency_hz:g}",
            f"{scale * getattr(design, f'{detect.quantity}_error'):.2g}",
            f"{100 * design.power:.0f} %",
            f"{design.session_minutes:.0f}",
            f"{design.total_hours:.0f}",
        )
    return table


def _entry(design: StudyDesign) -> DesignEntry:
    return DesignEntry(
        outcome=design.outcome,
        volunteers=design.volunteers,
        donnings=design.donnings,
        repeats=design.repeats,
        step_masses_kg=list(design.step_masses_kg),
        swing_frequency_hz=design.swing_frequency_hz,
        stiffness_error_n_per_m=design.stiffness_error,
        damping_error_n_s_per_m=design.damping_error,
        migration_error_m=design.migration_error,
        difference_error=design.difference_error,
        power=design.power,
        session_minutes=design.session_minutes,
        total_hours=design.total_hours,
    )
