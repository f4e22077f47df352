"""Variants of the muscle-redundancy problem that are compared with a measured joint force."""

from __future__ import annotations

from dataclasses import dataclass, replace

from solver.model import Model
from solver.redundancy.glenoid import with_rim
from solver.redundancy.options import RedundancyOptions

GIRDLE_AND_SHOULDER = (
    "scapula_abduction",
    "scapula_elevation",
    "scapula_upward_rot",
    "scapula_winging",
    "plane_elv",
    "shoulder_elv",
    "axial_rot",
)
"""Coordinates whose actuators have the published weight of 10."""
CUTOFF_HZ = 3.0


@dataclass(frozen=True)
class Variant:
    """A published variant of Hasan et al. (2025), or our defaults.

    rim  (along, across) tangents of the glenoid's rim, along the direction of its edge marker and across it; None for
         no cone, or in the defaults for the rim of the model's markers
    """

    name: str
    rim: tuple[float, float] | None
    is_published: bool

    def applied(self, model: Model) -> tuple[Model, RedundancyOptions]:
        """The model and the options of the variant."""
        if not self.is_published:
            return model, RedundancyOptions()
        options = published_options(model)
        if self.rim is None:
            return model, replace(options, has_glenoid_cone=False)
        along, across = self.rim
        return with_rim(model, along), replace(options, glenoid_aspect=across / along)


PUBLISHED_VARIANTS = (
    Variant("none", None, is_published=True),
    Variant("circle", (0.5, 0.5), is_published=True),
    Variant("ellipse", (0.34, 0.61), is_published=True),
)
VARIANTS = (*PUBLISHED_VARIANTS, Variant("defaults", None, is_published=False))


def published_options(model: Model) -> RedundancyOptions:
    """Weights of 1, but 10 on the actuators of scapulothoracic and glenohumeral coordinates; nothing is unweighted."""
    weights = {name: 10.0 for name in GIRDLE_AND_SHOULDER if name in model.actuated_names}
    return RedundancyOptions(unweighted_coordinates=(), reserve_weight=1.0, weights=weights)
