"""What joints do to their coordinates by themselves, against OpenSim."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from tests.solver.oracle.two_bodies import difference, given, model_with, opensim, read_back


@pytest.mark.parametrize("coordinate", ["first_coord_0", "first_coord_2", "second_coord_0"])
@pytest.mark.parametrize("joint", ["PlanarJoint", "FreeJoint"])
def test_a_spring_pulls_a_coordinate_to_its_rest(joint: str, coordinate: str, tmp_path: Path) -> None:
    model = model_with(getattr(opensim, joint))
    spring = opensim.SpringGeneralizedForce(coordinate)
    spring.setStiffness(7.0)
    spring.setRestLength(0.3)
    spring.setViscosity(0.4)
    model.addForce(given(spring))
    assert difference(model, tmp_path).is_nought()


@pytest.mark.parametrize("coordinate", ["first_coord_0", "first_coord_1", "second_coord_0"])
def test_a_limit_pushes_a_coordinate_back(coordinate: str, tmp_path: Path) -> None:
    model = model_with(opensim.PlanarJoint)
    is_angle = coordinate != "first_coord_1"
    upper, lower, transition = (20.0, -15.0, 30.0) if is_angle else (0.3, -0.2, 0.5)
    model.addForce(given(opensim.CoordinateLimitForce(coordinate, upper, 0.2, lower, 0.3, 0.01, transition)))
    assert difference(model, tmp_path).is_nought()


def test_an_actuator_keeps_the_limits_of_its_control(tmp_path: Path) -> None:
    model = model_with()
    for name, limits in (("free", ()), ("pushes", (0.0, 0.7)), ("held_below", (-0.2,))):
        actuator = opensim.CoordinateActuator("second_coord_0")
        actuator.setName(name)
        for limit, setting in zip(limits, (actuator.setMinControl, actuator.setMaxControl), strict=False):
            setting(limit)
        model.addForce(given(actuator))
    found = {each.name: (each.min_control, each.max_control) for each in read_back(model, tmp_path).actuators}
    assert found == {"free": (-np.inf, np.inf), "pushes": (0.0, 0.7), "held_below": (-0.2, np.inf)}
