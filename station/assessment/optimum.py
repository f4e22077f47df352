"""Optimise a suit: cuffs.json → optimum.json and suit.toml, with the fitted cuffs and on average over the draws."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np

from documents.message import Message
from recordings.manifest import DataOrigin
from solver.cuff import CuffParameters
from solver.redundancy.motion_solution import LoadedMotion
from solver.suit.cord import Condition
from solver.suit.optimise import Freedom, Pair, SuitCandidate, optimise_suit
from solver.suit.suit import PARTS, Suit, suit_toml
from solver.uncertainty.varied_model import drawn_cuffs
from station.assessment.assessment_inputs import (
    AssessmentInputs,
    cuff_findings,
    cuff_remarks,
    one_arm_cuff,
    read_cuffs_to_wear,
)
from station.assessment.assessment_json import CountEntry, KnownNumberEntry, StrictEntry, count, exact_number
from station.assessment.given_motion import load_checks, motion_checks, motion_findings
from station.checksums import write_checksums, write_whole
from station.folders import ensure_folder
from station.messages.assessment_messages import AssessmentCode
from station.progress import Progress, silent
from station.versions import solving_versions


class CandidateEntry(StrictEntry):
    """A suit and its cost with the fitted cuffs on all frames; the cost of the draws is on fewer frames."""

    rest_length_m: KnownNumberEntry
    stiffness_n_per_m: KnownNumberEntry
    waist_point_m: list[KnownNumberEntry]
    shoulder_point_m: list[KnownNumberEntry] | None = None
    arm_point_m: list[KnownNumberEntry]
    normalised_cost: KnownNumberEntry
    at_limit: list[str]
    outcome: str
    normalised_cost_of_draws: KnownNumberEntry | None = None


class OptimumDocument(StrictEntry):
    """optimum.json: the suit before and after, with the fitted cuffs and on average over the draws."""

    condition: Condition
    origin: str
    cuff: str
    free: list[str]
    start: CandidateEntry
    optimum: CandidateEntry
    robust_optimum: CandidateEntry
    suits_tried: CountEntry
    remarks: list[str]
    inputs: dict[str, str]
    versions: dict[str, str]


def optimise_file(
    inputs: AssessmentInputs,
    output: Path,
    condition: Condition = "both",
    free: tuple[Freedom, ...] = (),
    draws: int = 50,
    progress: Progress = silent,
) -> OptimumDocument:
    """Optimise for one arm cuff in one condition; write optimum.json, and the suits as files for `assess --suit`.

    suit.toml is the best with the fitted cuffs, robust_suit.toml the best on average over the draws, if there are any.
    """
    ensure_folder(output)
    cuffs = read_cuffs_to_wear(inputs.cuffs, inputs.chosen)
    waist, arm = one_arm_cuff(cuffs, inputs.chosen)
    model = inputs.read_model()
    kinematics = inputs.read_motion(model)
    loads, suit = inputs.read_loads(model, kinematics), inputs.read_suit()
    optimised = optimise_suit(
        LoadedMotion(model, kinematics, loads, inputs.read_options(model)),
        suit,
        (waist, arm),
        condition,
        free,
        drawn=_drawn_pairs(waist, arm, draws),
        progress=progress,
    )
    fits = [cuffs[cuff.name] for cuff in (arm, waist) if cuff]
    remarks = [*cuff_remarks(inputs.cuffs, fits), *map(str, cuff_findings(fits))]
    notes = motion_checks(model, kinematics) | load_checks(inputs.external_loads, loads, model, kinematics)
    remarks += map(str, motion_findings(notes))
    if draws and condition != "rigid" and not optimised.robust.drawn.size:
        remarks.append(str(Message(AssessmentCode.NO_COVARIANCE)))
    document = OptimumDocument(
        condition=condition,
        origin=DataOrigin.joined(fit.origin for fit in fits),
        cuff=arm.name,
        free=["rest_length", *free],
        start=_entry(optimised.start),
        optimum=_entry(optimised.fitted),
        robust_optimum=_entry(optimised.robust),
        suits_tried=count(optimised.tried),
        remarks=remarks,
        inputs=inputs.hashes(),
        versions=solving_versions(),
    )
    plain = document.model_dump(mode="json", exclude_unset=True)
    write_whole(output / "optimum.json", json.dumps(plain, indent=2, ensure_ascii=False, allow_nan=False) + "\n")
    _write_suit(output / "suit.toml", optimised.fitted, f"the best of {optimised.tried} suits tried with {arm.name}")
    written = ["optimum.json", "suit.toml"]
    if draws := optimised.robust.drawn.size:
        written.append("robust_suit.toml")
        _write_suit(output / written[-1], optimised.robust, f"the best on average over {draws} draws of the cuffs")
    write_checksums(*(output / name for name in written))
    return document


def _drawn_pairs(waist: CuffParameters | None, arm: CuffParameters, draws: int) -> list[Pair]:
    """Both cuffs, drawn from the uncertainty of their fits."""
    worn = [arm] if waist is None else [arm, waist]
    return [(next(iter(others), None), own) for own, *others in drawn_cuffs(worn, draws)]


def _write_suit(path: Path, tried: SuitCandidate, description: str) -> None:
    origin = f"# Suit of `station optimise`: {description}; details are in optimum.json."
    write_whole(path, f"{origin}\n\n{suit_toml(tried.suit)}")


def _entry(tried: SuitCandidate) -> CandidateEntry:
    suit = tried.suit
    entry: dict[str, object] = {
        "rest_length_m": exact_number(suit.reference_rest_length),
        "stiffness_n_per_m": exact_number(suit.stiffness),
        **{f"{part}_point_m": _point(suit, part) for part in PARTS if part != "shoulder" or not suit.is_straight},
        "normalised_cost": exact_number(tried.cost),
        "at_limit": list(tried.at_limit),
        "outcome": tried.outcome,
    }
    if tried.drawn.size:
        ends = np.quantile(tried.drawn, [0.025, 0.975]).tolist()
        entry["normalised_cost_of_draws"] = KnownNumberEntry(value=float(tried.drawn.mean()), ci95=ends)
    return CandidateEntry.model_validate(entry)


def _point(suit: Suit, part: str) -> list[KnownNumberEntry]:
    return [exact_number(float(x)) for x in getattr(suit, part).location]
