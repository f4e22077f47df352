"""A model and a suit with drawn parameters: new arrays in memory, no file is read again."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import scipy

from solver.cuff import CuffParameters
from solver.model import Array, Model, Muscle, PathPoint, with_mass_ratios
from solver.personalisation.anthropometry import ARM_SEGMENTS
from solver.redundancy.effort import RedundancyOptions
from solver.redundancy.mechanics import CENTER_MARKER, EDGE_MARKER
from solver.scaling import Scaling, scale_model
from solver.suit.suit import PARTS, Suit
from solver.uncertainty.factors import OUTERMOST, RandomFactor, Scores, normal_scores, scores_by_factor, unit_sample
from solver.uncertainty.sources import BodySpread, DonningSpread, FitSpread, MuscleSpread

LEAST_STIFFNESS = 0.05
"""Of a drawn cuff over the fitted one: an error of the fit that is normal would make it negative."""

NEXT_DONNING = np.sqrt(2.0)
"""Spread of the next donning about the measured one, over the spread between donnings: √(1 + 1/n). The fitted cuff is
that of n = 1 donning, which differs from the mean of all donnings as much as the next one does.
"""
NO_DONNING = DonningSpread(0.0, 0.0, 0.0)

MODEL_FACTORS = (
    "size",
    "segment_mass",
    "strength",
    "max_isometric_force",
    "optimal_fiber_length",
    "tendon_slack_length",
    "path_point",
    "glenoid_radius",
    "reserve_weight",
)
"""Factors of the redundancy problem; the other ones of the body change the suit only."""


def varied_model(model: Model, body: BodySpread, muscles: MuscleSpread, scores: Scores) -> Model:
    """The model of one person."""
    if "size" in scores:
        size = float(np.exp(body.size * scores["size"][0]))
        model = scale_model(model, Scaling({part.name: np.full(3, size) for part in model.bodies[1:]}))
    if "segment_mass" in scores:
        ratios = zip(ARM_SEGMENTS.values(), np.exp(body.segment_mass * scores["segment_mass"]).tolist(), strict=True)
        model = with_mass_ratios(model, {name: ratio for segment, ratio in ratios for name in segment.bodies})
    if "glenoid_radius" in scores:
        model = _with_glenoid(model, float(np.exp(muscles.glenoid_radius * scores["glenoid_radius"][0])))
    return replace(model, muscles=tuple(_muscle(m, i, muscles, scores) for i, m in enumerate(model.muscles)))


def varied_options(options: RedundancyOptions, muscles: MuscleSpread, scores: Scores) -> RedundancyOptions:
    """The effort that one person minimises."""
    if "reserve_weight" not in scores:
        return options
    ratio = float(np.exp(muscles.reserve_weight * scores["reserve_weight"][0]))
    return replace(options, reserve_weight=ratio * options.reserve_weight)


def varied_suit(suit: Suit, body: BodySpread, scores: Scores) -> Suit:
    """The suit on one person: its points move with the size of the body, and by their own error."""
    if "size" in scores:
        size = float(np.exp(body.size * scores["size"][0]))
        moved = {part: replace(at := getattr(suit, part), location=size * at.location) for part in PARTS}
        suit = replace(suit, **moved)
    if "attachment_point" in scores:
        shifts = body.attachment_point * scores["attachment_point"].reshape(3, 3)
        moved = {
            part: replace(at := getattr(suit, part), location=at.location + shift)
            for part, shift in zip(PARTS, shifts, strict=True)
        }
        suit = replace(suit, **moved)
    if "cord_stiffness" in scores:
        suit = replace(
            suit, stiffness=suit.stiffness * float(np.exp(body.cord_stiffness * scores["cord_stiffness"][0]))
        )
    return suit


def varied_cuff(cuff: CuffParameters, fit: FitSpread, donning: DonningSpread, scores: Scores) -> CuffParameters:
    """The cuff as its fit allows, and as it is donned another time."""
    values = cuff.figures
    if (name := f"fit.{cuff.name}") in scores:
        values = values + fit.factor * covariance_root(cuff.covariance) @ scores[name]
    if (name := f"donning.{cuff.name}") in scores:
        spreads = NEXT_DONNING * np.array(donning.spreads) * _spread_factors(donning, scores)
        values[: len(spreads)] *= np.exp(spreads * scores[name])
    drawn = cuff.with_figures(values.tolist())
    return replace(drawn, stiffness=max(drawn.stiffness, LEAST_STIFFNESS * cuff.stiffness))


def drawn_cuffs(cuffs: Sequence[CuffParameters], count: int) -> list[list[CuffParameters]]:
    """These cuffs, drawn together from the uncertainty of their fits; empty where none of them has one."""
    factors = [RandomFactor(f"fit.{cuff.name}", "fit", len(cuff.UNITS)) for cuff in cuffs if cuff.covariance.any()]
    if not factors or not count:
        return []
    sample = normal_scores(unit_sample(factors, count, "latin_hypercube", 1))
    drawn = [scores_by_factor(factors, row) for row in sample]
    return [[varied_cuff(cuff, FitSpread(), NO_DONNING, scores) for cuff in cuffs] for scores in drawn]


def _spread_factors(donning: DonningSpread, scores: Scores) -> Array:
    """√(ν / χ²) with ν degrees of freedom: draws about an estimated spread then have Student's t distribution."""
    freedom, factors = np.array(donning.freedom), np.ones(3)
    if (known := np.isfinite(freedom)).any():
        half = freedom[known] / 2
        chances = scipy.special.ndtr(scores["donning_spread"][known]).clip(OUTERMOST, 1 - OUTERMOST)
        factors[known] = np.sqrt(half / scipy.special.gammaincinv(half, chances))
    return factors


def covariance_root(covariance: Array) -> Array:
    """R (n, n) with R Rᵀ = covariance, which may be singular; scaled, because its units differ."""
    errors = np.sqrt(np.diag(covariance))
    scale = np.where(errors > 0, errors, 1.0)
    sizes, directions = np.linalg.eigh(covariance / np.outer(scale, scale))
    root: Array = scale[:, None] * directions * np.sqrt(sizes.clip(0))
    return root


def _with_glenoid(model: Model, ratio: float) -> Model:
    """The edge marker at this multiple of its distance from the centre; a model without the markers is unchanged."""
    markers = {marker.name: marker for marker in model.markers}
    if not markers.keys() >= {CENTER_MARKER, EDGE_MARKER}:
        return model
    center, edge = markers[CENTER_MARKER].location, markers[EDGE_MARKER].location
    moved = replace(markers[EDGE_MARKER], location=center + ratio * (edge - center))
    return replace(model, markers=tuple(moved if m.name == EDGE_MARKER else m for m in model.markers))


def _muscle(muscle: Muscle, index: int, spread: MuscleSpread, scores: Scores) -> Muscle:
    def factor(name: str, at: int = index) -> float:
        return float(np.exp(getattr(spread, name) * scores[name][at])) if name in scores else 1.0

    path = muscle.path
    if "path_point" in scores:
        shifts = spread.path_point * scores["path_point"].reshape(-1, 2, 3)[index]
        points = list(path.points)
        for end, shift in zip((0, -1), shifts, strict=True):
            point = points[end]
            if isinstance(point, PathPoint):  # an end that moves in its body keeps its course
                points[end] = replace(point, location=point.location + shift)
        path = replace(path, points=tuple(points))
    return replace(
        muscle,
        path=path,
        max_isometric_force=muscle.max_isometric_force * factor("max_isometric_force") * factor("strength", 0),
        optimal_fiber_length=muscle.optimal_fiber_length * factor("optimal_fiber_length"),
        tendon_slack_length=muscle.tendon_slack_length * factor("tendon_slack_length"),
    )
