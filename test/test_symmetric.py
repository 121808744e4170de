"""What may be exchanged: as data, as a group, and as a learner that makes use of it."""

from dataclasses import replace

import numpy as np
import pytest

from iolspi_ros import task as tasks
from iolspi_ros.core.learner import CompiledLearner, Learner, update
from iolspi_ros.core.lspi_settings import LSPISettings
from iolspi_ros.core.samples import Transition, Transitions
from iolspi_ros.core.symmetric import Group, SymmetricLSPI
from iolspi_ros.errors import InputError
from iolspi_ros.task import Symmetry
from sim_nodes.tasks.pendulum import Pendulum
from sim_nodes.tasks.slung_load_3d import SlungLoad3D

ABOUT = SlungLoad3D.description
GROUP = Group.of(ABOUT)


def states(n, seed=0):
    return np.random.default_rng(seed).uniform(ABOUT.low, ABOUT.high, (n, ABOUT.n_dims))


# ------------------------------------------------------------------ as data


def test_a_description_keeps_its_symmetries():
    assert [s.name for s in ABOUT.symmetries] == ["mirror in x", "mirror in y", "x for y"]
    assert tasks.load(tasks.dump(ABOUT), "here") == ABOUT


@pytest.mark.parametrize(
    ("changed", "words"),
    [
        ({"variables": ("x.position",)}, "variables of symmetry"),
        ({"actions": (0, 0, 2)}, "actions of symmetry"),
        ({"about": (1.0,)}, "about of symmetry"),
    ],
)
def test_what_exchanges_nothing_is_refused(changed, words):
    wrong = replace(ABOUT.symmetries[0], **changed)
    with pytest.raises(InputError, match=words):
        replace(ABOUT, symmetries=(wrong,))


def test_only_what_stays_the_same_is_called_a_symmetry():
    def named(**settings):
        return [s.name for s in SlungLoad3D(**settings).description.symmetries]

    assert named(basket=(1.0, 0.0, 1.0)) == ["mirror in y"]
    assert named(basket=(1.0, 1.0, 1.0)) == ["x for y"]
    assert named(basket=(1.0, -0.5, 1.0)) == []
    assert named(wind=3.0) == ["mirror in y"]
    assert len(named(vertical=True)) == 3
    assert named(accelerations=(0.0, 0.0, 1.0, 0.0)) == ["mirror in y"]


# ------------------------------------------------------------------ the group


def test_two_mirrors_and_an_exchange_make_eight_images():
    assert GROUP.take.shape == (8, 10)
    for one in range(8):  # each is undone by another
        there = GROUP.image(states(5), np.full(5, one))
        assert any(
            np.allclose(GROUP.image(there, np.full(5, back)), states(5)) for back in range(8)
        )
        assert sorted(GROUP.actions[one]) == list(range(10))
    undone = np.take_along_axis(GROUP.back, GROUP.actions, axis=1)
    np.testing.assert_array_equal(undone, np.tile(np.arange(10), (8, 1)))


def test_all_images_of_a_state_have_the_same_greatest():
    some = states(50)
    greatest = GROUP.image(some, GROUP.greatest(some))
    assert (greatest[:, 0] >= np.abs(greatest[:, 2])).all()
    assert (greatest[:, 2] >= 0.0).all()
    for one in range(8):
        image = GROUP.image(some, np.full(50, one))
        np.testing.assert_allclose(GROUP.image(image, GROUP.greatest(image)), greatest)


def test_the_nearest_image_undoes_a_turn():
    some = states(50, 1)
    near = some + 0.01
    for one in range(8):
        turned = GROUP.image(near, np.full(50, one))
        np.testing.assert_allclose(GROUP.nearest(some, turned, np.ones(10)), near)


@pytest.mark.parametrize("one", range(8))
def test_images_of_a_flight_are_flights(one):
    """The same start turned, with actions turned, is the same turned; but for the rotors' limits.

    The moments of inertia about x and y differ, so a rotor may be at its limit in one alone.
    """
    vehicle, image = SlungLoad3D(), SlungLoad3D()
    start = vehicle.begin(3)
    image.begin(3)
    which = np.array([one])
    _put(image, GROUP.image(start[None], which)[0])
    for action in (1, 4, 8, 2, 4, 5):
        state, reward, _, _ = vehicle.advance(action)
        other, same, _, _ = image.advance(int(GROUP.actions[one, action]))
        np.testing.assert_allclose(other, GROUP.image(state[None], which)[0], atol=1e-2)
        assert same == pytest.approx(reward, abs=1e-3)


def _put(vehicle, seen):
    """At rest where it is seen."""
    from sim_nodes.quadrotor.body import hovering

    now = vehicle._episode
    payload = now.payload
    now.craft.state[:] = hovering(
        vehicle._frame, payload, tuple(seen[[0, 2, 4]]), tuple(seen[[6, 8]])
    )
    now.seen[:] = seen


def test_symmetries_that_make_no_group_of_a_size_are_refused():
    with pytest.raises(InputError, match="0 symmetries"):
        Group.of(Pendulum().description)
    shifted = replace(ABOUT.symmetries[1], about=(1.0,) * 10)
    with pytest.raises(InputError, match="about 2 states"):
        Group.of(replace(ABOUT, symmetries=(ABOUT.symmetries[0], shifted)))
    names = tuple(f"v{n}" for n in range(9))
    turning = Symmetry("turn", names[1:] + names[:1], (0,))
    swapping = Symmetry("swap", (names[1], names[0], *names[2:]), (0,))
    many = replace(
        Pendulum().description, variables=tuple(tasks.Variable(n) for n in names),
        actions=(tasks.Action("a"),), neutral=0, map_variables=(), symmetries=(turning, swapping),
    )  # fmt: skip
    with pytest.raises(InputError, match="more than 64"):
        Group.of(many)


# ------------------------------------------------------------------ the learner


def learner(**settings):
    given = {"basis": "auto", "epsilon": 0.0, "update_interval": 50, "kernels": 40} | settings
    return SymmetricLSPI(ABOUT, LSPISettings(**given), np.random.default_rng(0))


def rows(n=200):
    task, rng, found = SlungLoad3D(), np.random.default_rng(1), []
    while len(found) < n:
        state, ended = task.begin(int(rng.integers(1000))), False
        for _ in range(20):
            action = int(rng.integers(10))
            after, reward, ended, _ = task.advance(action)
            found.append(Transition(state, action, reward, after, ended, False))
            state = after
            if ended:
                break
    return Transitions.of(found[:n], 10)


def test_it_is_a_learner_that_flies_step_by_step():
    assert isinstance(learner(), Learner)
    assert not isinstance(learner(), CompiledLearner)


def test_its_policy_has_the_symmetries():
    core = learner()
    core.pretrain(rows())
    some = states(40, 2)
    for one in range(8):
        which = np.full(40, one)
        there = core.values(GROUP.image(some, which))
        back = np.take_along_axis(there, GROUP.actions[which], axis=1)
        np.testing.assert_allclose(back, core.values(some), atol=1e-6)
    chosen = [core.act(state, explore=False)[0] for state in some]
    np.testing.assert_array_equal(chosen, core.values(some).argmax(axis=1))


def test_images_of_samples_teach_the_same():
    """Whoever is shown each sample from another side learns the same policy."""
    given, rng = rows(), np.random.default_rng(3)
    which = rng.integers(8, size=len(given))
    turned = replace(
        given, state=GROUP.image(given.state, which), action=GROUP.actions[which, given.action],
        next_state=GROUP.image(given.next_state, which),
    )  # fmt: skip
    one, other = learner(), learner()
    one.pretrain(given)
    other.pretrain(turned)
    np.testing.assert_allclose(one.values(states(30)), other.values(states(30)), rtol=1e-6)


def test_it_learns_online_and_goes_on_from_its_state():
    core, given = learner(), rows(120)
    for transition in given:
        if core.observe(transition):
            update(core)
    assert core.updates == 2
    other = learner()
    other.restore(core.state())
    np.testing.assert_array_equal(other.values(states(9)), core.values(states(9)))
    before = core.dropped
    assert not core.observe(Transition(states(1)[0], 99, 0.0, states(1)[0], False, False))
    assert core.dropped == before + 1


def test_its_shield_sees_no_jump_where_a_state_is_turned():
    """All that it learns of a change is as large as the changes that were flown."""
    core = learner(shield=True, envelope_low=(-5.0,) * 10, envelope_high=(5.0,) * 10)
    given = rows()
    core.pretrain(given)
    flown = np.abs(given.next_state - given.state).max(axis=0)
    turned = core._turned(given)
    near = GROUP.nearest(turned.state, turned.next_state, core.shield.half)
    moved = np.abs(near - turned.state).max(axis=0)
    assert moved[[0, 2]].max() <= flown[[0, 2]].max() + 1e-9
