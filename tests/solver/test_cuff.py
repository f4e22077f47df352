"""The law of a cuff: force, equilibrium and stiffness; figures and covariance by name; another law in a suit."""

import re
import sys
from dataclasses import dataclass
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest
from scipy import optimize

from solver.cuff import CuffLaw, CuffParameters, KelvinVoigt, Number
from solver.errors import SolverCode
from solver.suit.cord import CordLine, SuitForces, line_between, suit_forces
from solver.suit.suit import Suit, read_suit
from tests.refusals import raises_refusal

HAND = CuffParameters("hand", "arm", stiffness=8520.0, damping=210.0, migration=0.012)
PAGE = Path(__file__).parents[2] / "docs/how-to/law.md"


def test_a_cuff_at_rest_is_a_spring() -> None:
    law = KelvinVoigt(2140.0, 124.0)
    np.testing.assert_allclose(law.force(np.array([0.0, 0.01, -0.01]), np.zeros(3)), [0, 21.4, -21.4])
    np.testing.assert_allclose(law.equilibrium(np.array([0.0, 21.4, -21.4])), [0, 0.01, -0.01])


def test_a_cycle_costs_the_work_of_the_damper_alone() -> None:
    # π c ω X² over one period of a sine; the spring gives everything back
    omega, amplitude, damping = 2 * np.pi, 0.004, 124.0
    time = np.linspace(0, 1, 2001)
    displacement, velocity = amplitude * np.sin(omega * time), amplitude * omega * np.cos(omega * time)
    work = np.trapezoid(KelvinVoigt(2140.0, damping).force(displacement, velocity) * velocity, time)
    assert work == pytest.approx(np.pi * damping * omega * amplitude**2, rel=1e-6)


def test_parameters_that_were_given_have_no_uncertainty() -> None:
    assert HAND.covariance.shape == (3, 3)
    assert not HAND.covariance.any()


@pytest.mark.parametrize("shape", [(2, 2), (3,), (3, 4)])
def test_a_covariance_of_another_size_than_the_figures_is_refused(shape: tuple[int, ...]) -> None:
    with raises_refusal(SolverCode.WRONG_SHAPE, naming="covariance"):
        CuffParameters("hand", "arm", 8520.0, 210.0, 0.012, np.ones(shape))


def test_figures_are_changed_in_the_order_of_their_units() -> None:
    changed = CuffParameters("hand", "arm", 1.0, 2.0, 3.0).with_figures([5.0, 6.0, 7.0])
    assert (changed.stiffness, changed.damping, changed.migration, changed.name) == (5.0, 6.0, 7.0, "hand")


@dataclass(frozen=True)
class Page:
    """The module that docs/how-to/law.md writes."""

    module: ModuleType

    def cuff(self, stiffness: float, cubic: float, damping: float = 0.0) -> CuffParameters:
        made: CuffParameters = self.module.CubicCuff("hand", "arm", stiffness, damping, 0.0, cubic=cubic)
        return made


@pytest.fixture(scope="module")
def page() -> Page:
    """Runs the code of the page: its first block is the file, the others use it."""
    module = sys.modules["cubic_cuff"] = ModuleType("cubic_cuff")  # where its dataclasses look for their types
    for block in re.findall(r"(?:^    .*\n|^\n)+", PAGE.read_text(encoding="utf-8"), re.MULTILINE):
        code = "\n".join(line[4:] for line in block.splitlines())
        if code.strip():
            exec(compile(code, str(PAGE), "exec"), module.__dict__)  # noqa: S102 (our own page)
    return Page(module)


def test_the_equilibrium_of_the_cubic_law_is_the_root_of_its_cubic(page: Page) -> None:
    law = page.cuff(2000.0, 4e6).law
    load = np.array([-80.0, 0.0, 1e-3, 20.0, 150.0])
    roots = [next(float(r.real) for r in np.roots([4e6, 0.0, 2000.0, -f]) if abs(r.imag) < 1e-9) for f in load]
    np.testing.assert_allclose(law.equilibrium(load), roots, rtol=1e-9, atol=1e-15)
    np.testing.assert_allclose(law.force(np.array(roots), np.zeros(5)), load, rtol=1e-9, atol=1e-15)


def test_its_tangent_is_the_slope_of_its_force(page: Page) -> None:
    law, x, step = page.cuff(2000.0, 4e6).law, np.array([0.001, 0.01, 0.03]), 1e-7
    slope = (law.force(x + step, 0 * x) - law.force(x - step, 0 * x)) / (2 * step)
    np.testing.assert_allclose(law.tangent(x), slope, rtol=1e-6)


def still_line(frames: int = 5) -> CordLine:
    """The cord in one posture, 0.75 m long, bent over the shoulder."""
    anchors = np.tile([[0.0, 0.0, 0.0], [0.25, 0.5, 0.0]], (frames, 1, 1))
    return line_between(anchors, np.tile([0.0, 0.5, 0.0], (frames, 1)), np.tile(np.eye(3), (frames, 2, 1, 1)), 0.01)


def forces(suit: Suit, cuff: CuffParameters) -> SuitForces:
    return suit_forces(suit, still_line(), np.array([0.55, 0.65]), (None, cuff), yields=True)


def test_a_suit_wears_the_cubic_law(page: Page) -> None:
    # T = k_cord (L − L₀ − x) and T = k x + k₃ x³: the root by bisection
    suit, cuff = read_suit(), page.cuff(2000.0, 4e6, damping=50.0)
    found = forces(suit, cuff)
    for tension, rest in zip(found.tension, (0.55, 0.65), strict=True):
        x = optimize.brentq(lambda x, rest=rest: suit.stiffness * (0.75 - rest - x) - 2000 * x - 4e6 * x**3, 0, 0.2)
        np.testing.assert_allclose(tension, suit.stiffness * (0.75 - rest - x), rtol=1e-9)
    pull = np.linalg.norm(found.forces[:, :, 1], axis=-1)
    np.testing.assert_allclose(pull, found.tension, rtol=1e-9)  # at rest the cuff holds the cord
    slack = suit_forces(suit, still_line(), np.array([0.55, 0.8]), (None, cuff), yields=True)
    np.testing.assert_allclose(slack.tension[0], found.tension[0], rtol=1e-9)  # a slack length ends no search early
    assert not slack.tension[1].any() and not slack.displacement[1].any()


def test_a_cubic_law_without_its_cubic_is_the_linear_one(page: Page) -> None:
    suit = read_suit()
    linear = forces(suit, CuffParameters("hand", "arm", 2000.0, 50.0, 0.0))
    cubic = forces(suit, page.cuff(2000.0, 0.0, damping=50.0))
    np.testing.assert_allclose(cubic.tension, linear.tension, rtol=1e-12)
    np.testing.assert_allclose(cubic.forces, linear.forces, rtol=0, atol=1e-9)


def test_a_law_that_no_bushing_has_is_not_written(page: Page) -> None:
    law: CuffLaw = page.cuff(2000.0, 4e6).law
    with raises_refusal(SolverCode.SUIT_NOT_WRITABLE, "BushingForce"):
        law.bushing()


class Yielding(CuffLaw):
    """A spring whose force rises to 10 N and no further."""

    damping = 0.0

    def secant(self, distance: Number) -> Number:
        return 1000.0 / (1 + 100 * distance)

    def tangent(self, distance: Number) -> Number:
        return 1000.0 / (1 + 100 * distance) ** 2


def test_a_load_without_an_equilibrium_is_refused() -> None:
    assert Yielding().equilibrium(np.array([5.0])) == pytest.approx(0.01)
    with raises_refusal(SolverCode.CUFFS_NOT_AT_REST):
        Yielding().equilibrium(np.array([5.0, 20.0]))
