import numpy as np
import pytest

from iolspi_ros.core.learner import Source
from iolspi_ros.core.lspi_settings import LSPISettings
from iolspi_ros.core.online import OnlineLSPI
from iolspi_ros.core.samples import Transitions
from iolspi_ros.core.shield import HORIZON, allowed, lasting, predict, safest
from iolspi_ros.errors import InputError
from iolspi_ros.experiments.headless import Listener, train
from iolspi_ros.task import Action, TaskDescription, Variable
from sim_nodes.tasks import make_task
from sim_nodes.tasks.pendulum import Pendulum
from sim_nodes.tasks.slung_load import RELEASE, Outcome, outcome
from sim_nodes.world import World, WorldSettings

CART = LSPISettings(
    low=(-5.0, -3.0), high=(5.0, 3.0), centers=(5, 5), periodic=(False,),
    shield=True, envelope_low=(-5.0, -np.inf), envelope_high=(5.0, np.inf),
)  # fmt: skip
CART_TASK = TaskDescription(
    name="cart", variables=(Variable("x"), Variable("v")),
    actions=tuple(Action(name) for name in ("-", "0", "+")), sampling_time=0.1,
)  # fmt: skip
H = 0.1


def cart(state, action):
    """A cart that accelerates by -2, 0 or 2; returns the state after one step."""
    following = np.array(state, float)
    following[..., 0] += H * state[..., 1]
    following[..., 1] += H * 2.0 * (np.asarray(action) - 1)
    return following


def cart_shield(n=2000):
    rng = np.random.default_rng(0)
    state, action = rng.uniform((-5, -3), (5, 3), (n, 2)), rng.integers(3, size=n)
    none = np.zeros(n, bool)
    batch = Transitions(state, action, np.zeros(n), cart(state, action), none, none)
    return CART.guarded(CART_TASK).learn(batch)


def test_a_step_is_predicted_as_the_vehicle_makes_it():
    guard, terms, out = cart_shield().guard, np.empty(10), np.empty(2)
    for state, action in (((1.0, 2.0), 0), ((-4.9, -2.0), 2), ((0.0, 0.0), 1)):
        inside = predict(guard, np.array(state), action, terms, out)
        np.testing.assert_allclose(out, cart(np.array(state), action), atol=1e-6)
        assert inside == (abs(out[0]) <= 5.0)


def test_what_cannot_brake_in_time_is_vetoed_and_what_can_is_not():
    guard = cart_shield().guard
    # From v at 2 m/s² Euler's method needs x = H Σ v_k = v²/4 + H v/2 more to stop.
    for speed in (1.0, 1.6):  # stops within the horizon
        needed = speed**2 / 4 + H * speed / 2
        late, early = np.array([5.0 - needed + 0.1, speed]), np.array([5.0 - needed - 0.7, speed])
        assert not any(allowed(guard, late, action) for action in range(3))
        assert allowed(guard, early, 0)
        steps = [lasting(guard, late, action) for action in range(3)]
        assert steps[safest(guard, late, np.array([0.0, 1.0, 2.0]))] == max(steps) < HORIZON
    assert safest(guard, np.array([4.0, 1.8]), np.array([0.0, 1.0, 2.0])) == 0  # whatever Q̂ says
    assert lasting(guard, np.zeros(2), 2) == HORIZON
    assert safest(guard, np.zeros(2), np.array([0.0, 1.0, 2.0])) == 2


def test_batches_add_up_and_forget_as_moments_do():
    rng, n, eta = np.random.default_rng(1), 60, 0.9
    state, action = rng.uniform(-2, 2, (n, 2)), rng.integers(3, size=n)
    none = rng.random(n) < 0.2
    rows = Transitions(state, action, np.zeros(n), cart(state, action), none, none)
    whole, parts = CART.guarded(CART_TASK).learn(rows, eta), CART.guarded(CART_TASK)
    for first in range(0, n, 20):
        parts = parts.learn(rows[first : first + 20], eta)
    for name in ("gram", "cross", "seen", "ended"):
        np.testing.assert_allclose(getattr(parts, name), getattr(whole, name), rtol=1e-10)
    weight = eta ** np.arange(n - 1, -1, -1)
    assert whole.seen == pytest.approx(np.bincount(action, weight))
    assert not parts.guard.active  # twenty samples an action tell too little


def slung(shield):
    task = make_task("slung_load", {}, "test")
    settings = LSPISettings(
        low=(-6.5, -4.0, -np.pi / 2, -np.pi), high=(3.0, 4.0, np.pi / 2, np.pi),
        centers=(5, 1, 5, 1), periodic=(False,), epsilon=0.02,
        update_interval=500, refresh_iterations=1, shield=shield,
        envelope_low=(-6.5, -np.inf, -np.pi / 2, -np.inf),
        envelope_high=(3.0, np.inf, np.pi / 2, np.inf),
    )  # fmt: skip
    core = OnlineLSPI(task.description, settings, np.random.default_rng(0))
    rng, n = np.random.default_rng(2), 4000
    state, action = rng.uniform(settings.low, settings.high, (n, 4)), rng.integers(4, size=n)
    following, reward, ended = task.step(state, action)
    core.weights[RELEASE] -= 100.0  # hardly ever, so that episodes last
    core.shield = core.shield.learn(Transitions(state, action, reward, following, ended, ~ended))
    return core, World(task, WorldSettings(), np.random.default_rng(3))


def ends(core, world, episodes=150):
    """Outcomes of episodes, and actions with who chose them."""
    found, seen = [], []

    def look(observation, action, source):
        seen.append((action, source))
        if observation.last:
            found.append(int(outcome(observation.reward, observation.terminated)))

    train(world, core, episodes, Listener(look))
    return found, seen


def test_with_a_shield_hardly_anything_crashes_and_releases_are_never_vetoed():
    crashes = {}
    for shield in (False, True):
        core, world = slung(shield)
        found, seen = ends(core, world)
        crashes[shield] = sum(end in (Outcome.CABLE, Outcome.WALL) for end in found)
        assert core.vetoes == sum(source is Source.SHIELD for _, source in seen)
        assert bool(core.vetoes) == shield
    assert crashes[False] > 20
    assert crashes[True] <= crashes[False] / 5
    assert core.shield.guard.ends.tolist() == [False, False, False, True]
    assert allowed(core.shield.guard, np.array([-6.4, -4.0, 0.0, 0.0]), RELEASE)


def test_compiled_flight_vetoes_what_single_steps_veto():
    (one, world), (other, there) = slung(True), slung(True)
    ends(one, world, 40)
    train(there, other, 40, Listener())
    assert one.vetoes == other.vetoes > 0
    np.testing.assert_array_equal(one.weights, other.weights)
    np.testing.assert_array_equal(one.shield.gram, other.shield.gram)


def test_an_envelope_must_have_limits_that_fit():
    with pytest.raises(InputError, match="envelope_low has 3 entries; allowed: 2"):
        LSPISettings(envelope_low=(0.0, 0.0, 0.0)).resolve(Pendulum.description)
    with pytest.raises(InputError, match="each low < high"):
        LSPISettings(envelope_low=(1.0,), envelope_high=(1.0,))
    with pytest.raises(InputError, match="shield is on without a limit"):
        LSPISettings(shield=True)


# ------------------------------------------------------------------ many variables

WIDE = TaskDescription(
    name="eight",
    variables=tuple(Variable(f"v{n}", low=-1.0, high=1.0) for n in range(8)),
    actions=(Action("-", (-1.0,)), Action("0", (0.0,)), Action("+", (1.0,)), Action("end", (0.0,))),
    sampling_time=0.1,
    neutral=1,
)


def drifting(state, action):
    """v0 moves with v1, which the action pushes; the others with squares of v2."""
    after = state.copy()
    after[:, 0] += 0.2 * state[:, 1]
    after[:, 1] += 0.1 * (action - 1.0) * (action < 3)
    after[:, 3:] += 0.05 * state[:, 2:3] ** 2
    return after


def wide_rows(n, seed=0):
    rng = np.random.default_rng(seed)
    state, action = rng.uniform(-1, 1, (n, 8)), rng.integers(4, size=n)
    none = np.zeros(n, bool)
    return Transitions(state, action, np.zeros(n), drifting(state, action), action == 3, none)


def test_actions_of_many_variables_share_a_fit_and_differ_by_their_values():
    settings = LSPISettings(
        basis="auto",
        shield=True,
        envelope_low=(-1.0, *(-np.inf,) * 7),
        envelope_high=(1.0, *(np.inf,) * 7),
    ).resolve(WIDE)
    few = settings.guarded(WIDE).learn(wide_rows(100))
    assert not few.guard.active
    rows = wide_rows(250)  # 66 or so of each action: alone, none of the four would be enough
    shield = settings.guarded(WIDE).learn(rows)
    guard = shield.guard
    assert guard.active
    assert guard.ends.tolist() == [False, False, False, True]
    seen, terms = np.empty(8), np.empty(guard.weights.shape[2])
    for state in wide_rows(20, 1).state:
        for action in range(3):
            predict(guard, state, action, terms, seen)
            expected = drifting(state[None], np.array([action]))[0]
            np.testing.assert_allclose(seen, expected, atol=1e-5)
    near = np.zeros((1, 8))
    near[0, :2] = 0.85, 0.3  # only braking keeps it inside
    assert shield.among(near)[0].tolist() == [True, False, False, True]


def test_limits_of_two_variables_can_be_one_ellipse():
    corner, edge = (0.8, 0.8), (0.99, 0.0)
    for rounded, corner_is_inside in ((True, False), (False, True)):
        settings = LSPISettings(
            basis="auto",
            shield=True,
            envelope_low=(-1.0, -2.0, *(-np.inf,) * 6),
            envelope_high=(1.0, 2.0, *(np.inf,) * 6),
            envelope_round=(rounded, rounded, *(False,) * 6),
        ).resolve(WIDE)
        guard = settings.guarded(WIDE).learn(wide_rows(250)).guard
        seen, terms = np.empty(8), np.empty(guard.weights.shape[2])
        for place, expected in ((corner, corner_is_inside), (edge, True), ((1.01, 0.0), False)):
            # where action 0 leads to the place, in units of the half axes
            state = np.zeros(8)
            goal = np.array([place[0], 2.0 * place[1]])
            for _ in range(50):
                state[:2] += goal - drifting(state[None], np.array([0]))[0, :2]
            assert predict(guard, state, 0, terms, seen) is expected
            np.testing.assert_allclose(seen[:2], goal, atol=1e-3)


def test_an_ellipse_needs_its_limits():
    with pytest.raises(InputError, match="a finite number in envelope_low"):
        LSPISettings(
            envelope_low=(-1.0, -np.inf), envelope_high=(1.0, 1.0), envelope_round=(True, True)
        )
    with pytest.raises(InputError, match="envelope_round has 3 entries; allowed: 8"):
        LSPISettings(
            basis="auto", envelope_round=(True,) * 3, envelope_low=(-1.0,), envelope_high=(1.0,)
        ).resolve(WIDE)
