"""A learner on disk: nothing of it is lost, and what does not fit is refused with both sides."""

from dataclasses import fields, is_dataclass, replace

import numpy as np
import pytest

from iolspi_ros import task as tasks
from iolspi_ros.core.learner import update
from iolspi_ros.core.lspi_settings import LSPISettings
from iolspi_ros.core.online import OnlineLSPI
from iolspi_ros.core.samples import Transition, Transitions
from iolspi_ros.errors import InputError
from iolspi_ros.experiments.headless import Listener, train
from iolspi_ros.saving import checkpoint
from sim_nodes.tasks.pendulum import Pendulum
from sim_nodes.world import World, WorldSettings

TASK = Pendulum.description
KINDS = ("literal", "refreshed")


def learner(algorithm, seed=0, **changes):
    """With a shield, whose limits are seldom reached but always judged."""
    values = {
        "algorithm": algorithm, "centers": (4, 3), "update_interval": 50, "delta": 0.1,
        "shield": True, "envelope_low": (-np.inf, -6.0), "envelope_high": (np.inf, 6.0),
    }  # fmt: skip
    return OnlineLSPI(TASK, LSPISettings(**values | changes), np.random.default_rng([seed, 1]))


def world(seed):
    return World(Pendulum(), WorldSettings(), np.random.default_rng([seed, 0]))


def trained(algorithm):
    """In the middle of a batch, of an episode, and of its random numbers."""
    core = learner(algorithm)
    rng = np.random.default_rng(7)
    states = rng.uniform(TASK.low, TASK.high, (400, 2))
    actions = rng.integers(3, size=400)
    next_states, reward, ended = Pendulum().step(states, actions)
    core.pretrain(Transitions(states, actions, reward, next_states, ended, ended))
    train(world(0), core, 2, Listener())
    core.observe(Transition(np.zeros(2), 1, float("nan"), np.ones(2)))
    for k in range(7):
        core.observe(Transition(np.full(2, 0.1 * k), k % 3, -1.0 * k, np.ones(2), k == 6))
    return core


def leaves(part, path=""):
    """Everything in a state, by its path."""
    if is_dataclass(part):
        for field in fields(part):
            yield from leaves(getattr(part, field.name), f"{path}.{field.name}")
    else:
        yield path, part


def assert_same(one, other):
    found, wanted = dict(leaves(one.state())), dict(leaves(other.state()))
    assert found.keys() == wanted.keys()
    for path, value in wanted.items():
        np.testing.assert_array_equal(found[path], value, err_msg=path)
        if isinstance(value, np.ndarray):
            assert found[path].dtype == value.dtype, path


@pytest.mark.parametrize("algorithm", KINDS)
def test_nothing_is_lost(tmp_path, algorithm):
    before, after = trained(algorithm), learner(algorithm, seed=9)
    state = before.state()
    assert before.vetoes > 0
    assert before.dropped == 1
    assert state.shield.seen.sum() > 300
    assert len(state.batch) == 7
    if algorithm == "refreshed":
        assert state.buffer.demonstrated.any()
    else:
        assert state.moments.n_samples > 400
    checkpoint.save(tmp_path / "c.npz", before, "iolspi")
    checkpoint.load(tmp_path / "c.npz", after, "iolspi")
    assert_same(after, before)
    guards = before.shield.guard, after.shield.guard
    assert guards[0].active
    for a, b in zip(*guards, strict=True):
        np.testing.assert_array_equal(a, b)


def test_one_from_before_sources_were_known_is_read(tmp_path):
    before, after = trained("refreshed"), learner("refreshed", seed=9)
    checkpoint.save(tmp_path / "c.npz", before, "iolspi")
    content = checkpoint.read(tmp_path / "c.npz")
    arrays = {k: v for k, v in content.arrays.items() if k != "learner.batch_source"}
    assert len(arrays) == len(content.arrays) - 1
    checkpoint.restore(content._replace(arrays=arrays), after, "iolspi", "it")
    assert_same(after, before)


@pytest.mark.parametrize("algorithm", KINDS)
def test_it_goes_on_bit_by_bit(tmp_path, algorithm):
    before, after = trained(algorithm), learner(algorithm, seed=9)
    checkpoint.save(tmp_path / "c.npz", before, "iolspi")
    checkpoint.load(tmp_path / "c.npz", after, "iolspi")
    for core in (before, after):
        update(core)  # of the batch that had begun
        train(world(5), core, 2, Listener())
    assert_same(after, before)
    assert after.updates > 3


@pytest.mark.parametrize("algorithm", KINDS)
def test_the_learner_s_own_settings_stay(tmp_path, algorithm):
    checkpoint.save(tmp_path / "c.npz", learner(algorithm, epsilon=0.5), "iolspi")
    other = learner(algorithm, epsilon=0.1, envelope_high=(np.inf, 20.0))
    checkpoint.load(tmp_path / "c.npz", other, "iolspi")
    assert other.epsilon == 0.1
    assert other.shield.high.tolist() == [np.inf, 20.0]


def rewritten(path, change):
    """A checkpoint with something else in it, and the checksum of that."""
    about, arrays = checkpoint.read(path)
    change(about, arrays)
    with path.open("w+b") as file:
        checkpoint.write_into(file, checkpoint.Content(about, arrays))


@pytest.fixture(params=KINDS)
def saved(request, tmp_path):
    """A checkpoint, and a learner like the one that it is of."""
    path = tmp_path / "c.npz"
    checkpoint.save(path, trained(request.param), "iolspi")
    return path, learner(request.param, seed=3)


@pytest.mark.parametrize("number", [0, 1, 4, 6, "5", 5.5, None, True])
def test_another_format_is_refused(saved, number):
    path, core = saved
    rewritten(path, lambda about, _: about.update(format=number))
    with pytest.raises(InputError, match=r"damaged or of another format; allowed: .*format 5"):
        checkpoint.load(path, core, "iolspi")


@pytest.mark.parametrize("part", ["format", "learner", "run", "task", "settings", "parts"])
def test_one_without_a_part_is_refused(saved, part):
    path, core = saved
    rewritten(path, lambda about, _: about.pop(part))
    with pytest.raises(InputError, match=f"checkpoint {path} is damaged or of another format"):
        checkpoint.load(path, core, "iolspi")


def test_one_of_before_and_what_is_none_are_refused(saved):
    path, core = saved
    np.savez(path, weights=np.zeros((3, 12)))  # no seal: of a version before
    with pytest.raises(InputError, match="damaged or of another format"):
        checkpoint.load(path, core, "iolspi")
    np.savez(path, about=np.array("[1, 2]"))
    with pytest.raises(InputError, match="damaged or of another format"):
        checkpoint.load(path, core, "iolspi")
    with path.open("wb") as file:
        np.save(file, np.zeros(3))
    with pytest.raises(InputError, match="damaged or of another format"):
        checkpoint.load(path, core, "iolspi")


ARRAYS = ("learner.weights", "learner.batch.state", "learner.batch.reward",
          "learner.buffer.transitions.state", "learner.shield.gram", "learner.shield.seen",
          "learner.moments.gram")  # fmt: skip


def untouched(core, load):
    """What refused leaves the learner as it was."""
    before = dict(leaves(core.state()))
    with pytest.raises(InputError) as said:
        load()
    for path, value in leaves(core.state()):
        np.testing.assert_array_equal(value, before[path], err_msg=path)
    return str(said.value)


@pytest.mark.parametrize("name", ARRAYS)
def test_an_array_of_another_type_is_refused(saved, name):
    path, core = saved
    rewritten(path, lambda _, arrays: arrays.update({name: arrays[name].astype(np.float32)}))
    said = untouched(core, lambda: checkpoint.load(path, core, "iolspi"))
    assert said == f"checkpoint {path}: {name} is of type float32; allowed: float64"


@pytest.mark.parametrize("name", ARRAYS)
def test_a_missing_array_is_named(saved, name):
    path, core = saved
    rewritten(path, lambda _, arrays: arrays.pop(name))
    said = untouched(core, lambda: checkpoint.load(path, core, "iolspi"))
    assert said == f"checkpoint {path}: {name} is missing; allowed: a whole checkpoint"


@pytest.mark.parametrize("name", ARRAYS)
def test_an_array_of_another_shape_is_refused(saved, name):
    path, core = saved

    def grow(_, arrays):
        old = arrays[name]
        arrays[name] = np.zeros([n + 1 for n in old.shape])

    rewritten(path, grow)
    said = untouched(core, lambda: checkpoint.load(path, core, "iolspi"))
    assert said.startswith(f"checkpoint {path}: ")
    assert "shape" in said or "columns" in said or "none of task" in said


@pytest.mark.parametrize("name", ARRAYS)
def test_numbers_that_are_none_are_refused(saved, name):
    path, core = saved
    if not checkpoint.read(path).arrays[name].size:
        pytest.skip("the literal learner keeps no buffer, the refreshed one no matrices")

    def spoil(_, arrays):
        arrays[name] = arrays[name].copy()
        arrays[name].flat[-1] = np.nan

    rewritten(path, spoil)
    said = untouched(core, lambda: checkpoint.load(path, core, "iolspi"))
    assert "finite" in said


@pytest.mark.parametrize(
    ("name", "value", "words"),
    [("step", "7", "step is '7'; allowed: int"), ("step", 1.5, "step is 1.5; allowed: int"),
     ("updates", None, "updates is None; allowed: int"), ("vetoes", True, "vetoes is True; allow"),
     ("rng", {"bit_generator": "MT19937"}, "rng is no state of its random generator"),
     ("rng", [], r"rng is \[\]; allowed: dict"), ("rng", {}, "rng is no state")],
)  # fmt: skip
def test_a_number_that_is_none_is_named(saved, name, value, words):
    path, core = saved
    rewritten(path, lambda about, _: about["parts"]["learner"].update({name: value}))
    assert words.replace("\\", "") in untouched(core, lambda: checkpoint.load(path, core, "iolspi"))


def test_actions_that_the_task_does_not_have_are_refused(saved):
    path, core = saved

    def spoil(_, arrays):
        arrays["learner.batch.action"] = arrays["learner.batch.action"] + 3

    rewritten(path, spoil)
    said = untouched(core, lambda: checkpoint.load(path, core, "iolspi"))
    assert "batch holds transitions that are none of task pendulum" in said


@pytest.mark.parametrize(
    ("change", "words"),
    [({"sampling_time": 0.01}, "sampling_time is 0.005 here and 0.01 there"),
     ({"gamma": 0.9}, "gamma is 0.98 here and 0.9 there"),
     ({"name": "kite"}, "name is 'pendulum' here and 'kite' there")],
)  # fmt: skip
def test_one_of_another_task_is_refused_with_both_sides(saved, change, words):
    path, core = saved
    other = OnlineLSPI(replace(TASK, **change), core.settings, np.random.default_rng(0))
    said = untouched(other, lambda: checkpoint.load(path, other, "iolspi"))
    assert words in said
    assert f"here: checkpoint {path}; there: the vehicle" in said


def test_the_task_in_it_is_read_as_every_task_is(saved):
    path, core = saved
    rewritten(path, lambda about, _: about.update(task="]:"))
    assert f"checkpoint {path} is no YAML" in untouched(
        core, lambda: checkpoint.load(path, core, "iolspi")
    )
    rewritten(path, lambda about, _: about.update(task=tasks.dump(TASK)))
    checkpoint.load(path, core, "iolspi")


@pytest.mark.parametrize(
    ("change", "words"),
    [({"centers": (3, 4)}, "has centers [4, 3]; allowed: [3, 4], this learner's"),
     ({"width": 2.0}, "has width 1.0; allowed: 2.0"), ({"basis": "chebyshev"}, "has basis rbf")],
)  # fmt: skip
def test_settings_that_shape_it_must_be_the_same(saved, change, words):
    path, core = saved
    other = learner(core.settings.algorithm, **change)
    assert words in untouched(other, lambda: checkpoint.load(path, other, "iolspi"))


def test_the_other_algorithm_s_is_refused(tmp_path):
    path = tmp_path / "c.npz"
    checkpoint.save(path, learner("literal"), "iolspi")
    core = learner("refreshed")
    said = untouched(core, lambda: checkpoint.load(path, core, "iolspi"))
    assert "has algorithm literal; allowed: refreshed" in said
