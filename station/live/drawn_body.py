"""Model and suit of a set-up, for the views that draw the body."""

from __future__ import annotations

import tempfile
from pathlib import Path

from solver.bundled import bundled_model
from solver.model import Model
from solver.osim.model_reader import read_osim
from solver.suit.suit import Suit, read_suit
from station.live.published import LiveSetup


def drawn_body(setup: LiveSetup) -> tuple[Model, Suit | None]:
    """The suit is None if the model lacks one of its bodies. Raises SolverError for what cannot be read."""
    model, suit = read_model(setup.subject.model_osim), _suit(setup.suit_toml)
    bodies = {body.name for body in model.bodies}
    return model, suit if bodies >= {part.body for part in suit.line} else None


def read_model(osim: str) -> Model:
    """The model in the text of an OpenSim file; the bundled one for an empty text. Raises ModelError."""
    if not osim:
        return bundled_model()
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "body.osim"
        file.write_text(osim, encoding="utf-8")
        return read_osim(file, ignore_forces=True)


def _suit(toml: str) -> Suit:
    """The suit in the text of a suit.toml; the bundled one for an empty text. Raises SuitError."""
    if not toml:
        return read_suit()
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "suit.toml"
        file.write_text(toml, encoding="utf-8")
        return read_suit(file)
