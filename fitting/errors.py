"""Errors of a fit.

FitError
├── CodedError             has a stable code with figures
│   ├── UnusableTrial      a recording that cannot be fitted
│   │   └── NotConverged   as a fit that it needs did not converge
│   ├── NoTensor           directions that determine no stiffness tensor (spatial/tensors.py)
│   ├── NotIdentified      a cuff without a parameter that is needed (cuffs/wearable_cuff.py)
│   ├── ImpossibleCuff     a figure that no cuff on a body has (cuffs/wearable_cuff.py)
│   ├── UnnamedCuff        keys that do not make a cuff (cuffs/cuff_tables.py)
│   ├── MassCheckError     a known mass that cannot be compared (trial/mass_checks.py)
│   ├── ProtocolFileError  a protocol.toml that cannot be used (trial/trial.py)
│   ├── CuffsFileError     a cuffs.json that cannot be used (cuffs/cuffs_file.py)
│   └── UnusableEmg        EMG that cannot be processed or compared (emg/channels.py)
└── TooFewObservations     a study without spread (study/variance_components.py)
"""

from __future__ import annotations

from documents.message import Figures
from fitting.results.codes import FitErrorCode, FitOutcome
from fitting.results.sentences import Note
from fitting.results.trial_codes import RejectionCode, TensorCode


class FitError(Exception):
    """One sentence for the analyst; a second may say what to do."""

    exit_code = 1


class CodedError(FitError):
    """reason is the code with its figures; str() renders the sentence."""

    def __init__(self, code: RejectionCode | TensorCode | FitErrorCode, figures: Figures | None = None) -> None:
        super().__init__(code, figures)
        self.reason = Note(code, figures or {})

    @property
    def code(self) -> str:
        """The stable code, for programs; the command line shows it after the sentence."""
        return self.reason.code.value

    def __str__(self) -> str:
        return str(self.reason)


class UnusableTrial(CodedError):
    """The trial cannot be fitted."""


class NotConverged(UnusableTrial):
    """A fit that the trial needs did not converge."""

    outcome = FitOutcome.NOT_CONVERGED
