"""The root of what a fit raises.

FitError
├── UnusableTrial      a recording that cannot be fitted (quality.py)
├── NotIdentified      data that determine no estimate (result.py)
├── NoTensor           directions that determine no stiffness tensor (spatial/tensor.py)
├── MassCheckError     a known mass that cannot be compared (mass_checks.py)
├── ProtocolFileError  a protocol.toml that cannot be used (protocol_file.py)
└── CuffsFileError     a cuffs.json that cannot be used (cuffs_file.py)
"""

from __future__ import annotations


class FitError(Exception):
    """One sentence for the analyst; a second may say what to do."""

    exit_code = 1
