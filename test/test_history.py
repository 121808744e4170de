"""Episodes as they were seen, and what is made of them."""

import numpy as np
import pytest

from iolspi_ros import resources
from iolspi_ros.core.samples import Observation, Transition, Transitions
from iolspi_ros.experiments.evaluate import endings, evaluate, succeeded
from iolspi_ros.experiments.headless import prepare, train_beside
from iolspi_ros.experiments.history import EpisodeRecord
from iolspi_ros.task import Action, TaskDescription, Variable
from sim_nodes.tasks.pendulum import Pendulum
from sim_nodes.tasks.slung_load import SlungLoad
from sim_nodes.world import World, WorldSettings


def seen(step, last=False):
    return Observation(0, step, np.full(2, float(step)), -1.0 * step, 1, terminated=last)


def test_what_was_missed_is_filled_and_an_end_makes_it_whole():
    episode = EpisodeRecord()
    assert [episode.take(seen(k)) for k in (0, 1, 4)] == [0, 0, 2]
    assert [state[0] for state in episode.states] == [0, 1, 4, 4, 4]
    assert episode.rewards == [0, -1, -4, -4, -4]
    assert not episode.whole
    episode.take(seen(5, last=True))
    assert episode.whole
    assert episode.terminated


@pytest.mark.parametrize("task", [SlungLoad(), Pendulum()])
def test_episodes_of_any_length_are_judged_as_the_evaluation_does(task):
    weights = np.random.default_rng(1).standard_normal(
        (task.description.n_dims, task.description.n_actions)
    )
    scale = np.maximum(np.abs(task.description.low), np.abs(task.description.high))

    def policy(states):
        return np.argmax(np.sin(3.0 * states / scale) @ weights, axis=1)

    flown = evaluate(task, policy)
    world = World(task, WorldSettings(order="sweep"), np.random.default_rng(0))
    episodes = []
    for number in range(len(task.initial_states())):
        episodes.append(EpisodeRecord())
        here = world.begin(number)
        while episodes[-1].take(here) == 0 and not here.last:
            here = world.move(number, int(policy(here.state[None])[0]))
    np.testing.assert_array_equal(succeeded(task, episodes), flown.succeeded)
    ends = endings(task.description, episodes)
    np.testing.assert_array_equal(ends > 0, [e.terminated for e in episodes])
    if task.description.name == "slung_load":
        assert len({len(e.states) for e in episodes}) > 3
        np.testing.assert_array_equal(
            ends == [e.name for e in task.description.endings].index("dunk"), flown.succeeded
        )


class Staying:
    """Succeeds where the last state is the one that the episode ended in."""

    description = TaskDescription(
        "staying", (Variable("x"), Variable("y")), (Action("stay"),), 0.1, episode_steps=9
    )

    def succeeded(self, states, rewards):
        assert (states.shape, rewards.shape) == ((10, 2, 2), (9, 2))
        return (states[-1, :, 0] == 3.0) & (rewards.sum(axis=0) == -6.0)


def test_an_episode_that_ended_early_stays_where_it_ended():
    episode = EpisodeRecord()
    for step in range(4):
        episode.take(seen(step, last=step == 3))
    assert succeeded(Staying(), [episode, episode]).all()


def test_the_thesis_own_stands_beside_only_where_it_differs(tmp_path):
    """The slung load with T's own functions, and no shield."""
    file = resources.find("config", "slung_load.yaml")
    demonstrations = Transitions.of([Transition(np.zeros(4), 0, -1.0, np.ones(4))], 4)
    label, learner, history = train_beside("slung_load", file, 0, demonstrations, 2)
    assert learner.literal
    assert learner.settings.centers == (9, 1, 9, 1)
    assert not learner.settings.shield
    assert (len(history.episodes), len(history.demonstrations)) == (2, 1)
    own = file.read_text().replace("centers: [5, 4, 7, 4]", "centers: [9, 1, 9, 1]")
    own = own.replace("algorithm: refreshed", "algorithm: literal")
    other = tmp_path / "own.yaml"
    other.write_text(own)
    assert label == "thesis' algorithm to the letter"
    assert prepare("slung_load", other, 0).learner.literal
    assert train_beside("slung_load", other, 0, demonstrations, 2) is None
