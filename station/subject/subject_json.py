"""A wearer → the part of assessment.json on whose body and motion its figures are."""

from __future__ import annotations

import hashlib
from pathlib import Path
from typing import Any

import numpy as np

from documents.regular_file import LARGEST_SUIT, read_regular
from solver.suit.cord import CordCheck
from station.subject.assessed_subject import DRAWS, AssessedSubject
from station.subject.subject_document import BodyFactor, CordTension, MarkerResidual, SubjectDocument, WearerFinding
from station.subject.subject_file import SUBJECT_FILE

NORMAL_95 = 1.959964


def plain_subject(subject: AssessedSubject, spread: dict[str, float] | None, cord: CordCheck | None) -> dict[str, Any]:
    """The document as plain data."""
    estimate = subject.body.estimate
    posterior = subject.posterior
    factors = {
        factor.name: BodyFactor(value=float(value), ci95=[float(value - NORMAL_95 * e), float(value + NORMAL_95 * e)])
        for factor, value, e in zip(estimate.priors.factors, posterior.factors, posterior.factor_errors, strict=True)
    }
    return SubjectDocument(
        mass_kg=subject.body.body_mass,
        hand_load_kg=subject.declared.hand_load_kg,
        origin=subject.origin,
        motion=subject.assessed.file,
        condition=subject.assessed.manifest.condition or "",
        frames=len(subject.kinematics.time),
        interpolated_frames=subject.motion.interpolated,
        frames_left_out=subject.motion.left_out,
        drawn_motions=DRAWS,
        body_outcome=estimate.outcome,
        is_whole=subject.body.is_whole,
        factors=factors,
        trials=[_residual(subject, place) for place in range(len(subject.trials))],
        coordinates_not_measured=list(subject.not_measured),
        suit_point_spread_m=spread,
        cord=None if cord is None else _tension(cord),
        findings=[WearerFinding(code=finding.code, text=str(finding)) for finding in subject.body.findings],
    ).model_dump(mode="json")


def subject_inputs(folder: Path, subject: AssessedSubject) -> dict[str, str]:
    """Roles of the assessment's inputs → what stood for them."""
    digest = hashlib.sha256(read_regular(folder / SUBJECT_FILE, LARGEST_SUIT)).hexdigest()
    recorded = subject.assessed.sha256
    return {
        "model": f"{subject.model.name}, scaled to the wearer by {len(subject.trials)} trials",
        "motion": f"{subject.assessed.file} {recorded}",
        "subject": f"{SUBJECT_FILE} {digest}",
    }


def _residual(subject: AssessedSubject, place: int) -> MarkerResidual:
    postures = subject.body.estimate.postures[place]
    return MarkerResidual(
        file=subject.trials[place].file,
        rms_m=float(np.sqrt(np.nanmean(postures.residuals**2))),
        frames=len(postures.outcomes),
        unsolved_frames=postures.unsolved,
    )


def _tension(cord: CordCheck) -> CordTension:
    return CordTension(
        offset_n=cord.offset,
        rms_n=cord.rms,
        correlation=None if np.isnan(cord.correlation) else cord.correlation,
        largest_measured_n=float(cord.measured.max()),
        largest_predicted_n=float(cord.predicted.max()),
    )
