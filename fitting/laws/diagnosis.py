"""The eight checks on a donning, and the causes they point at."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from fitting.curves import TrialCurves
from fitting.dynamic.weak_form import ComplexStiffness
from fitting.laws.causes import Cause, causes_of
from fitting.laws.findings import Finding, find_all
from fitting.laws.model_class import ModelComparison
from fitting.results.codes import FindingCode
from fitting.uncertainty import Estimate


@dataclass(frozen=True)
class Diagnosis:
    """findings in the order D1 to D8, causes most severe first, none if all is well.

    classes is the comparison of laws, which calls a cuff softening whose held loads bend downward.
    """

    findings: tuple[Finding, ...]
    causes: tuple[Cause, ...]
    classes: ModelComparison | None


def diagnose(
    curves: Sequence[TrialCurves],
    stiffness: Estimate | None,
    bands: Sequence[ComplexStiffness],
    classes: ModelComparison | None,
    *,
    creeps: bool = True,
) -> Diagnosis:
    """The used trials of one donning in time order, its k, its complex stiffness and the comparison of classes.

    creeps is False where held loads do not go on yielding.
    """
    findings = tuple(find_all(curves, stiffness, bands))
    bends_down = any(finding.code is FindingCode.CURVATURE and finding.value < 0 for finding in findings)
    if classes is not None and bends_down:
        classes = classes.as_softening()
    return Diagnosis(findings, causes_of(findings, curves, classes, creeps=creeps), classes)
