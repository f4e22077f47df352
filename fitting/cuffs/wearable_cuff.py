"""A cuff for use in a suit: its figures and their uncertainty, from a fit, from a cuffs.json or as given in Python."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from numbers import Real
from typing import TYPE_CHECKING, Any, Literal
from xml.sax.saxutils import quoteattr

import numpy as np
from numpy.typing import NDArray

from documents.interval import plus_minus
from documents.results import Curve, EqualByFields, curves_svg, result_html
from fitting.errors import CodedError
from fitting.results.codes import FitErrorCode, NoteCode, Verdict
from fitting.results.cuffs_schema import POSSIBLE, is_covariance
from fitting.results.sentences import Note, verdict_text
from fitting.uncertainty import NORMAL_95, Estimate, normal_estimate
from recordings.manifest import DataOrigin, is_file_name
from solver.cuff import CuffParameters, KelvinVoigt

if TYPE_CHECKING:
    import pandas as pd

QUANTITIES = {"stiffness": "stiffness_n_per_m", "damping": "damping_n_s_per_m", "migration": "migration_m"}
"""Field of Cuff and CuffFit → key in cuffs.json, in the order of CuffParameters' covariance."""
KNOWN_LAW, TENSOR = KelvinVoigt.NAME, "tensor"
"""Names of laws in cuffs.json: F = k x + c ẋ along one line, and in three dimensions."""
UNITS = CuffParameters.UNITS
Figure = Estimate | float | tuple[float, float]
"""An estimate, a number, or a number and its standard error."""


class NotIdentified(CodedError):
    """A cuff lacks a figure that was asked for; the figures name the cuff, the missing quantities and the verdict."""


class ImpossibleCuff(CodedError):
    """A figure that no cuff on a body has; it is in another unit."""


@dataclass(frozen=True, eq=False, repr=False)
class Cuff(EqualByFields):
    """k [N/m], c [N s/m] and migration [m] of a cuff, None where there is no figure.

        Cuff("hand", stiffness=8520, damping=210, migration=0.012)

    A figure may be a number, or a number and its standard error. site: "waist" for a cuff of this name, else "arm".
    Raises ImpossibleCuff for a number out of the range of a cuff on a body, TypeError or ValueError for anything else.

    missing     quantities that are absent or not identified, and so must not be used
    covariance  (3, 3) of (stiffness, damping, migration); zero where one is None or was given
    law         extensions of the law F = k x + c ẋ that its trials or its file state, none for that law alone
    sources     file → SHA-256 of every recording that the figures are from
    origin      of those recordings: simulated if any of them is, unknown where the figures were given
    given       figures that were entered by hand
    assumed     assumptions that make it usable;  notes  remarks as sentences
    causes      trials that ended early, which explain verdicts
    """

    name: str
    site: Literal["arm", "waist"]
    donning: str
    stiffness: Estimate | None
    damping: Estimate | None
    migration: Estimate | None
    missing: tuple[str, ...]
    verdicts: tuple[Verdict, ...]
    covariance: NDArray[np.float64]
    law: tuple[str, ...]
    sources: Mapping[str, str]
    origin: DataOrigin
    given: tuple[str, ...]
    assumed: tuple[Note, ...]
    notes: tuple[str, ...]
    causes: tuple[Note, ...]

    def __init__(  # noqa: PLR0913 (the fields of the class)
        self,
        name: str,
        *,
        stiffness: Figure | None = None,
        damping: Figure | None = None,
        migration: Figure | None = None,
        site: Literal["arm", "waist"] | None = None,
        donning: str = "",
        missing: tuple[str, ...] | None = None,
        verdicts: tuple[Verdict, ...] = (Verdict.GIVEN,),
        covariance: NDArray[np.float64] | None = None,
        law: tuple[str, ...] = (),
        sources: Mapping[str, str] | None = None,
        origin: DataOrigin = DataOrigin.UNKNOWN,
        given: tuple[str, ...] | None = None,
        assumed: tuple[Note, ...] = (),
        notes: tuple[str, ...] = (),
        causes: tuple[Note, ...] = (),
    ) -> None:
        site = site or ("waist" if name == "waist" else "arm")
        _ensure_usable(name, site, covariance)
        figures = {"stiffness": stiffness, "damping": damping, "migration": migration}
        estimates = {key: _as_estimate(name, key, figure) for key, figure in figures.items()}
        if missing is None:
            missing = tuple(key for key, estimate in estimates.items() if estimate is None)
        if given is None:
            given = tuple(key for key, figure in figures.items() if figure is not None and figure is not estimates[key])
        fields = {
            "name": name,
            **estimates,
            "site": site,
            "donning": donning,
            "missing": missing,
            "verdicts": verdicts,
            "covariance": joint_covariance(list(estimates.values())) if covariance is None else covariance,
            "law": law,
            "sources": sources or {},
            "origin": origin,
            "given": given,
            "assumed": assumed,
            "notes": notes,
            "causes": causes,
        }
        for field, value in fields.items():
            object.__setattr__(self, field, value)

    @property
    def verdict(self) -> str:
        """All verdicts as one text."""
        return verdict_text(self.verdicts, self.causes)

    @property
    def remarks(self) -> tuple[str, ...]:
        """Remarks on the origin of the figures, as clauses."""
        simulated = ("simulated data",) if self.origin is DataOrigin.SIMULATED else ()
        by_hand = tuple(
            f"{name} {estimate.value:.6g} {UNITS[name]} is given by hand"
            for name, estimate in self._estimates().items()
            if name in self.given and estimate
        )
        return simulated + by_hand

    def __repr__(self) -> str:
        donning = f", donning {self.donning}" if self.donning else ""
        lines = [
            f"{name:9}  {estimate.text(UNITS[name]) if estimate else 'no value'}"
            + (", not identified" if name in self.missing else "")
            for name, estimate in self._estimates().items()
        ]
        return "\n".join([f"Cuff {self.name}{donning}: {self.verdict}", *lines])

    def to_dataframe(self) -> pd.DataFrame:
        """A row per quantity, with its unit, value, standard_error, ci95_low, ci95_high and is_identified."""
        import pandas as pd

        return pd.DataFrame([self._row(name, estimate) for name, estimate in self._estimates().items()])

    def covariance_dataframe(self) -> pd.DataFrame:
        """The covariance with the names of the quantities as rows and columns, in the units of attrs["units"]."""
        import pandas as pd

        table = pd.DataFrame(self.covariance, index=list(UNITS), columns=list(UNITS))
        table.attrs["units"] = dict(UNITS)
        return table

    def _repr_html_(self) -> str:
        return cuff_html({self.name: self}, {})

    def parameters(self) -> CuffParameters:
        """For the solver. Raises NotIdentified if a figure is missing."""
        if self.missing or self.stiffness is None or self.damping is None or self.migration is None:
            figures = {"cuff": self.name, "missing": " and ".join(self.missing), "verdict": self.verdict}
            raise NotIdentified(FitErrorCode.NOT_IDENTIFIED, figures)
        return CuffParameters(
            name=self.name,
            site=self.site,
            stiffness=self.stiffness.value,
            damping=self.damping.value,
            migration=self.migration.value,
            covariance=self.covariance,
            source=" ".join(self.sources.values()) or Verdict.GIVEN.sentence(),
        )

    def without_migration(self) -> Cuff:
        """The cuff with zero migration if only migration is missing; otherwise unchanged."""
        if self.missing != ("migration",):
            return self
        none = Estimate(0.0, 0.0, (0.0, 0.0))
        return replace(self, migration=none, missing=(), assumed=(*self.assumed, Note(NoteCode.NO_SHIFT)))

    def _estimates(self) -> dict[str, Estimate | None]:
        return dict(zip(UNITS, (self.stiffness, self.damping, self.migration), strict=True))

    def _row(self, name: str, estimate: Estimate | None) -> dict[str, Any]:
        low, high = estimate.ci95 if estimate else (np.nan, np.nan)
        return {
            "cuff": self.name,
            "donning": self.donning,
            "quantity": name,
            "unit": UNITS[name],
            "value": estimate.value if estimate else np.nan,
            "standard_error": estimate.standard_error if estimate else np.nan,
            "ci95_low": low,
            "ci95_high": high,
            "is_identified": name not in self.missing,
        }


def _ensure_usable(name: object, site: object, covariance: object) -> None:
    """Raise ValueError for a name that cuffs.json refuses, another site, or a matrix that is no covariance."""
    if not is_file_name(name):
        raise ValueError(f"name should be one that a file can have, such as hand, and is {name!r}")
    if site not in ("arm", "waist"):
        raise ValueError(f"site of cuff {name} should be arm or waist and is {site!r}")
    if covariance is not None and not is_covariance(np.asarray(covariance)):
        raise ValueError(
            f"covariance of cuff {name} should be a symmetric, positive semi-definite (3, 3) matrix of finite numbers"
        )


def _as_estimate(cuff: str, quantity: str, figure: Figure | None) -> Estimate | None:
    """The estimate of a figure. Raises TypeError, and ImpossibleCuff for a number out of range."""
    if figure is None or isinstance(figure, Estimate):
        return figure
    value, error = figure if isinstance(figure, tuple) and len(figure) == 2 else (figure, 0.0)
    if not isinstance(value, Real) or not isinstance(error, Real) or isinstance(value, bool):
        found = type(figure).__name__
        raise TypeError(f"{quantity} should be a number, or a number and its standard error, and got a {found}")
    low, high, unit = POSSIBLE[QUANTITIES[quantity]]
    for key, number, least, most in (
        (quantity, float(value), low, high),
        (f"the standard error of its {quantity}", float(error), 0.0, high),
    ):
        if not least <= number <= most:
            figures = {"cuff": cuff, "figure": key, "value": number, "low": least, "high": most, "unit": unit}
            raise ImpossibleCuff(FitErrorCode.CUFF_IMPOSSIBLE, figures)
    return normal_estimate(float(value), float(error))


def joint_covariance(estimates: Sequence[Estimate | None]) -> NDArray[np.float64]:
    """Covariance of k, c and migration of one donning, 0 for None. A wrong gain of the load cell or direction of the
    pull scales k and c alike; their other errors, and that of migration, are independent.
    """
    covariance = np.zeros((len(estimates), len(estimates)))
    for cause in ("gain", "direction"):
        scaled = [math.copysign(one.parts.get(cause, 0.0), one.value) if one else 0.0 for one in estimates]
        covariance += np.outer(scaled, scaled)
    np.fill_diagonal(covariance, [one.standard_error**2 if one else 0.0 for one in estimates])
    return covariance


def cuff_html(cuffs: Mapping[str, Cuff], pulls: Mapping[str, Curve]) -> str:
    """A row per quantity of every cuff, and force [N] over displacement [mm] of the pulls that were used."""
    rows = [_html_row(cuff, name) for cuff in cuffs.values() for name in QUANTITIES]
    remark = "; ".join(f"{cuff.name}: {cuff.verdict}" for cuff in cuffs.values())
    drawing = curves_svg(list(pulls.values()), "mm", "N")
    return result_html(f"Cuffs: {', '.join(cuffs)}", ("cuff", "quantity", "value", "unit", ""), rows, remark, drawing)


def _html_row(cuff: Cuff, name: str) -> tuple[str, str, str, str, str]:
    estimate = getattr(cuff, name)
    if estimate is None:
        return cuff.name, name, "–", UNITS[name], "not identified"
    scale, unit = (1e3, "mm") if name == "migration" else (1.0, UNITS[name])
    is_missing, is_given = name in cuff.missing, name in cuff.given
    remark = "not identified" if is_missing else "given by hand" if is_given else "95 % interval"
    return cuff.name, name, plus_minus(estimate.value, estimate.ci95, scale, 1), unit, remark


def with_interval_covariance(cuff: Cuff) -> CuffParameters:
    """k, c and migration with a covariance whose normal 95 % intervals are those of the fit. Raises NotIdentified."""
    parameters = cuff.parameters()
    errors = np.sqrt(np.diag(parameters.covariance))
    ends = [getattr(cuff, name).ci95 for name in UNITS]
    wanted = np.maximum(errors, np.diff(ends, axis=1)[:, 0] / (2 * NORMAL_95))
    scale = np.divide(wanted, errors, out=np.ones(len(UNITS)), where=errors > 0)
    covariance = parameters.covariance * np.outer(scale, scale)
    np.fill_diagonal(covariance, wanted**2)
    return replace(parameters, covariance=covariance)


MEASURED_ALONG = (
    "k and c were measured along one line of pull and are used for all three directions; the rotational terms are zero "
    "because they were not measured. socket_frame1 is the body under the cuff, socket_frame2 the cuff."
)


def bushing_force(wearable: Cuff) -> str:
    """An XML element, k in N/m and c in N s/m. Raises NotIdentified if a figure is missing."""
    cuff = wearable.parameters()
    stiffness, damping = (" ".join([repr(value)] * 3) for value in cuff.law.bushing())
    return (
        f"<BushingForce name={quoteattr(f'{cuff.name}_cuff')}>\n"
        f"  <!-- {MEASURED_ALONG} -->\n"
        f"{''.join(f'  <!-- {remark} -->{chr(10)}' for remark in wearable.remarks)}"
        f"  <socket_frame1>/bodyset/{'humerus' if cuff.site == 'arm' else 'thorax'}</socket_frame1>\n"
        f"  <socket_frame2>/bodyset/{cuff.name}_cuff</socket_frame2>\n"
        "  <rotational_stiffness>0 0 0</rotational_stiffness>\n"
        f"  <translational_stiffness>{stiffness}</translational_stiffness>\n"
        "  <rotational_damping>0 0 0</rotational_damping>\n"
        f"  <translational_damping>{damping}</translational_damping>\n"
        "</BushingForce>\n"
    )
