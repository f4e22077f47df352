"""One body for all lifts of a patient with an instrumented shoulder prosthesis, against the force measured in it.

    python -m benchmarks.subject_body [--data ../shared/data/subject] [--lifts side back] [--keep-tendons]
                                      [--fibres 0.6 1.3]

The patient is S8R of Hasan et al. (2025), 830 N, with 2.4 kg in the hand. The body is that of `station scale` from all
lifts named; nothing is locked. Muscles are solved as published: weights 1, but 10 on actuators of scapulothoracic and
glenohumeral coordinates, nothing unweighted; a circular cone of tangent 0.5; the first lift of each record. Prints
per lift the residual of the markers, the range of the fibres, and RMSE, correlation and ratio of peaks of the joint
force; then the same for a lift whose body comes from the other lifts only.

In generic.osim the names of the two wrist markers are exchanged (`station scale` finds pronation out of its range);
they are exchanged back here, or left with --wrist-as-is.
"""

from __future__ import annotations

import argparse
import tempfile
import xml.etree.ElementTree as Xml
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from time import process_time

import numpy as np
from numpy.typing import NDArray

from recordings.exchange.joint_force import read_joint_force
from solver.inverse_kinematics.solve import solve_inverse_kinematics
from solver.model import CoordinateLock, Model
from solver.motion import Motion, differentiate
from solver.osim.reader import read_osim
from solver.osim.writer import osim_document
from solver.personalisation.tendons import fit_tendons
from solver.redundancy.force_agreement import ForceAgreement, force_agreement
from solver.redundancy.motion import solve_motion
from solver.scaling_findings import muscle_ranges
from station.kinematics.person import PersonBody, PersonInputs, measure_person
from station.validation.variants import CUTOFF_HZ, PUBLISHED_VARIANTS
from tests.solver.references import SHARED

Array = NDArray[np.float64]

BODY_WEIGHT = 830.0  # N
BODY_MASS = BODY_WEIGHT / 9.81
HELD_MASS = 2.4
FIRST_LIFT_S = {"side": 4.0, "back": 3.4, "front": 4.5}
CIRCLE = PUBLISHED_VARIANTS[1]
EXCHANGED = {"US2": "RS2", "RS2": "US2"}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--data", type=Path, default=SHARED / "subject", help="generic.osim, S8R_<lift>.trc and forces")
    parser.add_argument("--lifts", nargs="+", default=["side", "back"])
    parser.add_argument("--keep-tendons", action="store_true")
    parser.add_argument("--fibres", nargs=2, type=float, help="range that tendons keep, in place of 0.5 to 1.45")
    parser.add_argument("--wrist-as-is", action="store_true")
    given = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        generic = renamed_generic(given.data, Path(folder), is_renamed=not given.wrist_as_is)

        def measured(lifts: Sequence[str]) -> PersonBody:
            files = tuple(given.data / f"S8R_{lift}.trc" for lift in lifts)
            is_kept = given.keep_tendons or given.fibres is not None
            person = measure_person(PersonInputs(generic, files, BODY_MASS, HELD_MASS, is_kept))
            if given.fibres is None:
                return person
            motions = [trial.postures.coordinates for trial in person.trials]
            return replace(person, model=fit_tendons(person.model, motions, tuple(given.fibres))[0])

        began = process_time()
        person = measured(given.lifts)
        print(f"body from {', '.join(given.lifts)} in {process_time() - began:.0f} s of processor time")
        for k, factor in enumerate(person.estimate.priors.factors):
            print(f"  {factor.name}: {person.estimate.factors[k]:.2f} ± {person.estimate.factor_errors[k]:.2f}")
        for finding in person.findings:
            print(f"  [{finding.code.value}] {finding}")
        print("| lift | body from | markers [mm] | fibres | RMSE [% BW] | r | ratio of peaks |")
        print("|---|---|---:|---:|---:|---:|---:|")
        for k, lift in enumerate(given.lifts):
            print(_row(given.data, lift, person, person.trials[k].time, person.trials[k].postures.coordinates, "all"))
        for lift in given.lifts if len(given.lifts) > 1 else ():
            others = [other for other in given.lifts if other != lift]
            print(_other_row(given.data, lift, measured(others), ", ".join(others)))


def renamed_generic(data: Path, folder: Path, *, is_renamed: bool) -> str:
    """Path of generic.osim in the folder, its wrist markers as the trials name them."""
    model = read_osim(data / "generic.osim")
    if is_renamed:
        markers = (replace(marker, name=EXCHANGED.get(marker.name, marker.name)) for marker in model.markers)
        model = replace(model, markers=tuple(markers))
    Xml.ElementTree(osim_document(model)).write(folder / "generic.osim", encoding="utf-8")
    return str(folder / "generic.osim")


def _other_row(data: Path, lift: str, person: PersonBody, source: str) -> str:
    from recordings.exchange.trc import read_trc

    table = read_trc(data / f"S8R_{lift}.trc")
    columns = [table.labels.index(marker.name) for marker in person.estimate.tasks.markers]
    free = tuple(c for c in person.model.constraints if not isinstance(c, CoordinateLock))
    observed = 1e-3 * table.positions[:, columns]
    solution = solve_inverse_kinematics(replace(person.model, constraints=free), observed, person.estimate.tasks)
    rms = float(np.sqrt(np.nanmean(solution.residuals**2)))
    return _row(data, lift, person, table.time_s, solution.coordinates, source, rms)


def _row(
    data: Path, lift: str, person: PersonBody, time: Array, coordinates: Array, source: str, rms: float | None = None
) -> str:
    trial = next((trial for trial in person.trials if trial.name == f"S8R_{lift}"), None)
    rms = rms if rms is not None or trial is None else trial.rms
    ranges = muscle_ranges(person.model, coordinates)
    error = joint_force_error(data, lift, person.model, time, coordinates)
    cells = [
        lift,
        source,
        f"{1e3 * (rms or 0.0):.1f}",
        f"{ranges.shortest.min():.2f} to {ranges.longest.max():.2f}",
        f"{100.0 * error.rmse / BODY_WEIGHT:.0f}",
        f"{error.correlation:.2f}",
        f"{error.peak_ratio:.2f}",
    ]
    return f"| {' | '.join(cells)} |"


def joint_force_error(data: Path, lift: str, model: Model, time: Array, coordinates: Array) -> ForceAgreement:
    """Of the first lift at time (frames,) [s] with coordinates (frames, coordinates), solved as published."""
    model, options = CIRCLE.applied(model)
    kinematics = differentiate(Motion(model.coordinate_names, time, coordinates), CUTOFF_HZ, 0.0, FIRST_LIFT_S[lift])
    solution = solve_motion(model, kinematics, options)
    record = read_joint_force(data / f"S8R_{lift}_measured_force_glenoid.txt")
    measured = np.interp(solution.time, record.time_s, record.resultant)
    return force_agreement(np.linalg.norm(solution.reaction[:, 3:], axis=1), measured)


if __name__ == "__main__":
    main()
