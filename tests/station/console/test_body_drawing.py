"""The body on the live page is that of the model, scaled or not."""

from __future__ import annotations

from xml.etree import ElementTree

import numpy as np
import pytest

from solver.bundled import bundled_model
from solver.multibody.postures import points_in_ground, postures
from solver.osim.model_writer import osim_document
from solver.suit.suit import read_suit
from station.console.live_feed import BodyDrawing
from station.live.drawn_body import read_model


def test_muscles_begin_at_their_origins_and_the_cord_at_the_waist() -> None:
    model, suit = bundled_model(), read_suit()
    q = model.default_coordinates
    lines = BodyDrawing(model, suit).lines(q.tolist())
    state = postures(model, q[None], np.zeros((1, len(q))))
    assert len(lines["muscles"]) == len(model.muscles)
    for muscle, drawn in zip(model.muscles, lines["muscles"], strict=True):
        origin = points_in_ground(state, muscle.path.points[0].body, muscle.path.points[0].location)[0]
        assert drawn[0] == pytest.approx(1e3 * origin, abs=0.5)
    waist = points_in_ground(state, model.body_index(suit.waist.body), suit.waist.location)[0]
    assert lines["cord"][0] == pytest.approx(1e3 * waist, abs=0.5)
    assert len(lines["cord"]) == 3
    assert BodyDrawing(model, None).lines(q.tolist())["cord"] == []


def test_a_model_sent_as_an_opensim_file_is_drawn_alike() -> None:
    model = bundled_model()
    osim = ElementTree.tostring(osim_document(model), encoding="unicode")
    q = model.default_coordinates.tolist()
    sent, own = (BodyDrawing(one, None).lines(q) for one in (read_model(osim), read_model("")))
    for name in ("bones", "muscles"):
        assert len(sent[name]) == len(own[name])
    for one, other in zip(sent["muscles"], own["muscles"], strict=True):
        assert np.array(one) == pytest.approx(np.array(other), abs=1.0)
