"""Which segments a marker set determines: the smallest set that is honest, by segment.

Three markers hold a segment by themselves. The thorax needs them, because every other segment is measured against it
(IJ, PX, C7, T8; ISB, Wu et al. 2005, J. Biomech. 38:981). The scapula needs them, too: a cluster on the acromion with
AA, TS and AI pointed in. Without, or with one marker on its acromion, its orientation follows from the closure at the
acromioclavicular joint and from coordinate tasks. The humerus needs a cluster or both epicondyles, and axial rotation a
marker on the forearm or the cluster.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence

from solver.errors import CoverageCode
from solver.model import Marker, Model

HOLDING = 3
FOREARM = ("ulna", "radius", "hand")


ESSENTIAL = (CoverageCode.THORAX_NOT_DETERMINED, CoverageCode.HUMERUS_NOT_DETERMINED)
"""Without these segments there is no posture of the shoulder to speak of."""


def check_coverage(model: Model, markers: Sequence[Marker]) -> tuple[CoverageCode, ...]:
    """Codes for the segments of a shoulder model that the markers on it do not determine; segments that the model does
    not have are passed over.
    """
    names = {body.name for body in model.bodies}
    counts = Counter(model.bodies[marker.body].name for marker in markers)
    forearm = sum(counts[name] for name in FOREARM)
    codes = []
    if "thorax" in names and counts["thorax"] < HOLDING:
        codes.append(CoverageCode.THORAX_NOT_DETERMINED)
    if "scapula" in names and counts["scapula"] < HOLDING:
        has_some = counts["scapula"] > 1  # one marker shows a place, and the clavicle shows the same
        codes.append(CoverageCode.FEW_SCAPULA_MARKERS if has_some else CoverageCode.NO_SCAPULA_MARKERS)
    if "humerus" in names:
        if counts["humerus"] == 0:
            codes.append(CoverageCode.HUMERUS_NOT_DETERMINED)
        elif counts["humerus"] < HOLDING and forearm == 0:
            codes.append(CoverageCode.AXIAL_ROTATION_UNCERTAIN)
    if names.intersection(FOREARM) and forearm == 0:
        codes.append(CoverageCode.NO_FOREARM_MARKERS)
    return tuple(codes)
