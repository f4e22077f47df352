"""A generic model → a model of a person's size, by OpenSim's set-up of scaling."""

from __future__ import annotations

import xml.etree.ElementTree as Xml
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from recordings.exchange.trc import read_trc
from solver.marker_placement import place_markers
from solver.model import Model, ModelError
from solver.motion import MotionError
from solver.osim.scale_setup import read_scale_setup
from solver.osim.writer import osim_document
from solver.scaling import Scaling, scale_model
from solver.scaling_findings import ScalingCode, ScalingFinding, check_scaling
from station.assessment.sources import model_of
from station.kinematics.ik import named_file
from station.whole_file import drafted

Array = NDArray[np.float64]

SENTENCES = {
    ScalingCode.POINT_INSIDE_SURFACE: "{muscle}: a path point lies inside {surface}, unlike in the generic model",
    ScalingCode.FIBRE_LENGTH: "{muscle}: its fibre is {figure:.2f} of the optimal length in the default posture",
    ScalingCode.PATH_LENGTH: "{muscle}: its path is {figure:.2f} times as long, measured by the median of all muscles",
}


@dataclass(frozen=True)
class ScaleInputs:
    """Files; model and markers may come from the set-up. scales_joined_points as in solver.scaling.Scaling."""

    setup: Path
    model: str | None = None
    markers: Path | None = None
    scales_joined_points: bool = True


@dataclass(frozen=True, eq=False)
class ScaledBody:
    """The scaled model, the factors (3,) of each body by name, and findings on what may be wrong with it."""

    model: Model
    factors: dict[str, Array]
    findings: tuple[ScalingFinding, ...]
    notes: tuple[str, ...]


def scale_body(inputs: ScaleInputs) -> ScaledBody:
    """Raises ModelError, MotionError, ForeignFile for files that do not fit together."""
    setup = read_scale_setup(inputs.setup)
    generic = model_of(str(inputs.model or named_file(setup.model_file, "model", "--model")))
    file = inputs.markers or named_file(setup.marker_file, "markers' file", "--markers")
    table = read_trc(file, tracked=[marker.name for marker in generic.markers])
    first, last = setup.time_range
    shown = (table.time_s >= first - 1e-6) & (table.time_s <= last + 1e-6)
    if not shown.any():
        raise MotionError(f"{file.name} has no frame between {first:g} and {last:g} s; correct the set-up's time_range")
    observed = 1e-3 * table.positions[shown]
    factors = setup.factors(generic, table.labels, observed)
    scaling = Scaling(factors, setup.mass, setup.keeps_masses, inputs.scales_joined_points)
    scaled = scale_model(generic, scaling)
    if setup.placement is not None:
        with np.errstate(invalid="ignore"):
            counts = np.isfinite(observed).sum(axis=0)
            static = np.where(counts > 0, np.nansum(observed, axis=0) / np.maximum(counts, 1), np.nan)
        tasks = setup.placement.tasks(scaled, table.labels, table.time_s[shown][:1])
        scaled = place_markers(scaled, table.labels, static, tasks)
    return ScaledBody(scaled, factors, check_scaling(generic, scaled), table.notes)


def write_body(path: Path, body: ScaledBody) -> None:
    """The model as .osim: what the solver knows of it, without pictures of bones."""
    if path.suffix != ".osim":
        raise ModelError(f"the scaled model should be written as .osim and is {path.name}; choose such a name")
    with drafted(path) as draft:
        Xml.ElementTree(osim_document(body.model)).write(draft, encoding="utf-8", xml_declaration=True)


def summary(body: ScaledBody) -> list[str]:
    """Factors, mass and findings, line by line."""
    lines = [f"{name}: {' × '.join(f'{each:.4f}' for each in factors)}" for name, factors in body.factors.items()]
    lines.append(f"mass of the model {sum(each.mass for each in body.model.bodies):.2f} kg")
    return lines + [SENTENCES[finding.code].format(**vars(finding)) for finding in body.findings]
