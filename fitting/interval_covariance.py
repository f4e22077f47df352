"""Parameters of a cuff whose covariance covers the 95 % intervals of its fit.

The intervals are wider than 1.96 standard errors where few repeats leave the spread between repeats uncertain. Draws
from the parameters must be as wide.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from fitting.uncertainty import NORMAL_95
from fitting.wearable_cuff import WearableCuff
from solver.cuff import PARAMETER_ORDER, CuffParameters


def with_interval_covariance(cuff: WearableCuff) -> CuffParameters:
    """k, c and migration with a covariance whose normal 95 % intervals are those of the fit. Raises NotIdentified."""
    parameters = cuff.parameters()
    errors = np.sqrt(np.diag(parameters.covariance))
    ends = [getattr(cuff, name).ci95 for name in PARAMETER_ORDER]
    wanted = np.maximum(errors, np.diff(ends, axis=1)[:, 0] / (2 * NORMAL_95))
    scale = np.divide(wanted, errors, out=np.ones(3), where=errors > 0)
    covariance = parameters.covariance * np.outer(scale, scale)
    np.fill_diagonal(covariance, wanted**2)
    return replace(parameters, covariance=covariance)
