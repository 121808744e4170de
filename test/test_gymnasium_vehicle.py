"""Environments of Gymnasium as vehicles: described, flown, learned, alone and through the graph."""

import io
import itertools
import signal

import numpy as np
import PIL.Image
import pytest
from conftest import Peer
from sensor_msgs.msg import CompressedImage

from iolspi_ros import qos
from iolspi_ros.core.learner import learner_class
from iolspi_ros.errors import InputError
from iolspi_ros.experiments.evaluate import evaluate
from iolspi_ros.experiments.headless import Listener, make_learner, prepare, train
from iolspi_ros.saving import checkpoint
from iolspi_ros.task import dump, load
from sim_nodes.tasks import task_class
from sim_nodes.tasks.base import Judging, Stateful
from sim_nodes.world import WorldSettings, make_world

gymnasium = pytest.importorskip("gymnasium")
CART_POLE = "gymnasium:CartPole-v1"


def write(path, text):
    path.write_text(text)
    return str(path)


@pytest.mark.parametrize(
    ("name", "dims", "actions", "steps"),
    [
        (CART_POLE, 4, 2, 500),
        ("gymnasium:MountainCar-v0", 2, 3, 200),
        ("gymnasium:Pendulum-v1", 3, 3, 200),  # continuous: least, middle, largest
        ("gymnasium:FrozenLake-v1", 1, 4, 100),  # a number for a state
    ],
)
def test_the_spaces_make_the_description(name, dims, actions, steps):
    about = task_class(name).description
    assert (about.n_dims, about.n_actions, about.episode_steps) == (dims, actions, steps)
    assert load(dump(about), "itself") == about


def test_steps_are_those_of_the_environment_alone():
    world = make_world(
        task_class(CART_POLE)(), WorldSettings(order="sweep"), np.random.default_rng(0)
    )
    env = gymnasium.make("CartPole-v1")
    rng = np.random.default_rng(1)
    for seed in range(3):
        seen = world.begin(seed)
        np.testing.assert_array_equal(seen.state, env.reset(seed=seed)[0].astype(float))
        while not seen.last:
            action = int(rng.integers(2))
            seen = world.move(seed, action)
            state, reward, terminated, truncated, _ = env.step(action)
            np.testing.assert_array_equal(seen.state, state.astype(float))
            assert (seen.reward, seen.terminated, seen.truncated) == (reward, terminated, truncated)


def test_what_the_clock_cuts_is_truncated_and_not_terminated():
    world = make_world(
        task_class("gymnasium:MountainCar-v0")(), WorldSettings(), np.random.default_rng(0)
    )
    seen = world.begin(0)
    while not seen.last:
        seen = world.move(0, 1)
    assert (seen.step, seen.terminated, seen.truncated) == (200, False, True)


def test_random_episodes_follow_from_the_seed():
    def starts(seed):
        world = make_world(task_class(CART_POLE)(), WorldSettings(), np.random.default_rng(seed))
        return np.array([world.begin(n).state for n in range(4)])

    np.testing.assert_array_equal(starts(0), starts(0))
    assert len(np.unique(starts(0), axis=0)) == 4
    assert (starts(0) != starts(1)).any()


def test_a_policy_is_judged_from_the_seeds_and_by_what_it_earns():
    vehicle = task_class(CART_POLE)()
    assert isinstance(vehicle, Stateful)
    assert isinstance(vehicle, Judging)

    def balances(states):
        return (states @ [0.0, 0.1, 1.0, 0.5] > 0).astype(int)

    good = evaluate(vehicle, balances)
    bad = evaluate(vehicle, lambda states: np.zeros(len(states), int))
    assert good.score.shape == (vehicle.starts,)
    assert good.success_fraction > 0.9
    assert bad.success_fraction == 0.0
    assert (bad.score < 12).all()
    assert [vehicle.description.endings[e].name for e in bad.ending] == ["end"] * vehicle.starts


def test_a_file_cuts_continuous_actions_and_names_variables(tmp_path):
    path = write(
        tmp_path / "swing.yaml",
        """
gymnasium: Pendulum-v1
arguments: {g: 5.0}
actions: [-2.0, {name: nothing, value: 0.0}, 1.5]
variables: [{name: up}, {name: right}, {name: turning, unit: rad/s}]
gamma: 0.9
success_return: -500
starts: 3
""",
    )
    cls = task_class(path)
    about = cls.description
    assert about.names == ("up", "right", "turning")
    assert about.variables[2].low == -8.0
    assert [a.value for a in about.actions] == [(-2.0,), (0.0,), (1.5,)]
    assert (about.neutral, about.gamma, cls.starts) == (1, 0.9, 3)
    vehicle, env = cls(), gymnasium.make("Pendulum-v1", g=5.0)
    vehicle.begin(4)
    env.reset(seed=4)
    np.testing.assert_array_equal(vehicle.advance(2)[0], env.step(np.array([1.5]))[0].astype(float))


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("gymnasium: NoSuch-v0", "cannot be made"),
        ("gymnasium: CartPole-v1\nwind: 3", "'wind'; allowed"),
        ("gymnasium: Pendulum-v1\nactions: [9.0]", "from [-2.0] to [2.0]"),
        ("gymnasium: CartPole-v1\nactions: [left]", "actions has 1 entries; allowed: 2"),
        ("gymnasium: CartPole-v1\nvariables: [{name: x}]", "variables has 1 entries; allowed: 4"),
        ("gymnasium: CartPole-v1\ngamma: quick", "gamma is 'quick'; allowed: a number"),
        ("gymnasium: CartPole-v1\narguments: {color: red}", "cannot be made"),
        ("gymnasium: !!python/object/apply:os.system ['touch x']", "is no YAML"),
        ("something: else", "names no environment"),
        ("state: {}\ncommand: {}", "iolspi run vehicle"),
    ],
)
def test_a_file_that_will_not_do_is_named(tmp_path, text, says):
    path = write(tmp_path / "bad.yaml", text)
    with pytest.raises(InputError) as error:
        task_class(path)
    assert says in str(error.value)
    assert path in str(error.value)


def test_without_gymnasium_it_says_what_to_install(monkeypatch):
    import sys

    monkeypatch.setitem(sys.modules, "gymnasium", None)
    with pytest.raises(InputError, match=r"pip install iolspi_ros\[gymnasium\]"):
        task_class("gymnasium:Acrobot-v1")


def test_noise_on_numbered_actions_is_refused():
    world = make_world(
        task_class(CART_POLE)(), WorldSettings(action_noise=1.0), np.random.default_rng(0)
    )
    world.begin(0)
    with pytest.raises(InputError, match="numbers in a list"):
        world.move(0, 0)


@pytest.mark.parametrize("name", ["CartPole-v1", "LunarLander-v3"])
def test_looking_changes_nothing_and_shows_what_the_environment_draws(name):
    def fly(looking):
        vehicle, seen, images = task_class(f"gymnasium:{name}")(), [], []
        for seed in (7, 8):
            states = [vehicle.begin(seed)]
            for k in range(15):
                images.append(vehicle.image() if looking else None)
                state, reward, *ended = vehicle.advance(k % 2)
                states.append(np.array([*state, reward, *ended]))
            seen += states
        return seen, images

    alone, (watched, images) = fly(looking=False)[0], fly(looking=True)
    for one, other in zip(alone, watched, strict=True):
        np.testing.assert_array_equal(one, other)
    assert all(image is None for image in images[:15])  # from the next episode on
    env = gymnasium.make(name, render_mode="rgb_array")
    env.reset(seed=8)
    np.testing.assert_array_equal(images[15], env.render())
    assert any((a != b).any() for a, b in itertools.pairwise(images[15:]))


def test_what_cannot_draw_itself_says_so(monkeypatch):
    vehicle = task_class(CART_POLE)()
    vehicle.image()
    vehicle.begin(0)

    def fail():
        raise gymnasium.error.DependencyNotInstalled("pygame is not installed")

    monkeypatch.setattr(vehicle._env, "render", fail)
    with pytest.raises(InputError, match="pygame is not installed"):
        vehicle.image()
    silent = task_class(CART_POLE)()
    monkeypatch.setitem(silent._env.unwrapped.metadata, "render_modes", ["ansi"])
    for seed in (0, 1):
        assert silent.image() is None
        silent.begin(seed)


def test_whoever_looks_sees_its_images(nodes, ros):
    peer = Peer(ros)
    peer.listen("image/compressed", CompressedImage, qos.LATCHED)
    nodes.start(
        "simulator", "-p", f"task:={CART_POLE}", "-p", "mode:=realtime",
        "-p", "real_time_factor:=10.0",
    )  # fmt: skip
    peer.until(lambda: peer.heard["image/compressed"])
    message = peer.heard["image/compressed"][0]
    image = PIL.Image.open(io.BytesIO(message.data))
    assert (image.format, image.size) == ("JPEG", (600, 400))
    assert message.header.stamp.sec + message.header.stamp.nanosec > 0


def test_the_graph_gives_the_same_weights_as_no_graph(nodes, tmp_path):
    path, seed, episodes = tmp_path / "c.npz", 3, 30
    values = {"centers": [3, 3, 3, 3], "update_interval": 200}
    shared = ["-p", "centers:=[3,3,3,3]", "-p", "update_interval:=200"]
    nodes.start(
        "learner", "-p", "wait_for_demonstrations:=false", "-p", f"checkpoint:={path}",
        "-p", f"seed:={seed}", *shared,
    )  # fmt: skip
    nodes.start(
        "simulator", "-p", f"task:={CART_POLE}", "-p", f"episodes:={episodes}",
        "-p", f"seed:={seed}",
    )  # fmt: skip
    nodes.wait_for("simulator", "done:")
    for name in ("simulator", "learner"):
        assert nodes.end(name, signal.SIGTERM) == 0, nodes.log(name)
    setup = prepare(CART_POLE, None, seed)
    learner = make_learner("iolspi", setup.learner.task, values, "test", seed)
    train(setup.world, learner, episodes, Listener())
    other = learner_class("iolspi")(
        learner.task, learner.settings, np.random.default_rng([seed, 1])
    )
    checkpoint.load(path, other, "iolspi")
    assert other.step == learner.step
    np.testing.assert_array_equal(other.weights, learner.weights)
