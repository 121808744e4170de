"""`iolspi demos` and `iolspi new-task`, as a user types them."""

import contextlib
import csv
import sys
from pathlib import Path

import numpy as np
import pytest
import yaml
from test_any_bag import TASK, flight, samples, write

from iolspi_ros import bags, cli
from iolspi_ros.bags import lerobot
from iolspi_ros.bags.export import write_bag
from iolspi_ros.bags.survey import oddities
from iolspi_ros.core.learner import Source
from iolspi_ros.errors import InputError
from iolspi_ros.experiments.headless import Listener, prepare, train
from iolspi_ros.resources import find
from iolspi_ros.task import load
from msg_bridge.ros.description import read_robot
from sim_nodes.tasks.pendulum import Pendulum

SET_1 = str(find("demos", "pendulum", "set_1"))


@pytest.fixture
def iolspi(monkeypatch, capsys):
    def run(*arguments):
        monkeypatch.setattr(sys, "argv", ["iolspi", *map(str, arguments)])
        try:
            status = cli.main()
        except SystemExit as end:
            status = end.code or 0
        said = capsys.readouterr()
        return status, " ".join((said.out + said.err).split())

    return run


def test_bags_are_listed_and_told(iolspi):
    status, said = iolspi("demos", "list", find("demos"))
    assert status == 0
    assert said.count("6300 samples of pendulum") == 5
    status, said = iolspi("demos", "info", SET_1)
    assert status == 0
    assert "vehicle / run 1 (6300 samples of 21 episodes); 0 ended by the task, 21 by" in said


def test_a_good_bag_passes_the_check(iolspi):
    status, said = iolspi("demos", "check", SET_1)
    assert status == 0
    assert "pendulum, 6300 samples, " in said


def odd(tmp_path, change):
    """What is said of 300 samples, each changed by a function of its entries."""

    def messages():
        rng = np.random.default_rng(0)
        for topic, kind, time, message in samples(1, 300):
            names = message.layout.dim[0].label.split(",")
            entries = dict(zip(names, message.data.tolist(), strict=True))
            entries |= {"reward": -rng.random(), "shaft.velocity": rng.uniform(-40, 40),
                        "truncated": float(entries["step"] == 299)}  # fmt: skip
            change(entries)
            message.data = np.array(list(entries.values()))
            yield topic, kind, time, message

    found = bags.read_demonstration(write(tmp_path / "bag", messages()), TASK)
    return " ".join(oddities(found))


def put(**values):
    return lambda entries: entries.update({k.replace("__", "."): v for k, v in values.items()})


@pytest.mark.parametrize(
    ("change", "says"),
    [
        (put(), ""),
        (put(shaft__position=0.5), "shaft.position never moves: it is 0.5"),
        (put(action=2), "-3 V, 0 V"),
        (put(reward=-1.0), "every reward is -1"),
        (put(truncated=0.0), "no episode has an end"),
        (put(reward=np.nan), "300 of 300 samples are not usable"),
        (lambda e: e.update({"shaft.position": 57.3 * e["shaft.position"]}), "are these degrees?"),
        (lambda e: e.update({"shaft.velocity": e["shaft.velocity"] / 1e3}), "is the unit right?"),
        (lambda e: e.update(nanosec=e["step"] * 1e7 % 1e9, sec=e["step"] * 1e7 // 1e9),
         "the sampling time is 0.01 s; the task's is 0.005 s"),
        (lambda e: e.update({"shaft.position": 0.1 + e["step"] / 1e4,
                             "shaft.velocity": e["step"] / 100}), "of the boxes of"),
    ],
)  # fmt: skip
def test_what_is_odd_is_said(tmp_path, change, says):
    found = odd(tmp_path, change)
    assert says in found if says else found == ""


def test_an_odd_bag_fails_the_check(iolspi, tmp_path):
    path = write(tmp_path / "bag", samples(1))
    status, said = iolspi("demos", "check", path, "--task", "pendulum")
    assert status == 1
    assert "every reward is -1" in said


def test_bags_are_joined_and_divided(iolspi, tmp_path):
    one, two = write(tmp_path / "one", samples(1)), write(tmp_path / "two", flight(2))
    both = tmp_path / "both"
    assert iolspi("demos", "merge", one, two, "--out", both, "--task", "pendulum")[0] == 0
    assert len(bags.read_demonstration(both, TASK).samples) == 60
    assert iolspi("demos", "merge", one, "--out", both, "--task", "pendulum")[0] == 2
    joined = write(tmp_path / "joined", [*flight(1, prefix="/v1"), *flight(3, prefix="/v1")])
    parts = tmp_path / "parts"
    status, said = iolspi("demos", "split", joined, "--out", parts, "--task", "pendulum")
    assert (status, sorted(p.name for p in parts.iterdir())) == (0, ["v1_run_1", "v1_run_2"]), said
    assert len(bags.read_demonstration(parts / "v1_run_2", TASK).samples) == 30
    assert "30 samples" in iolspi("demos", "info", parts / "v1_run_2")[1]  # it says its own task


def test_a_bag_with_several_runs_is_chosen_from_by_option(iolspi, tmp_path):
    path = write(tmp_path / "bag", [*samples(1), *samples(2)])
    status, said = iolspi("demos", "check", path, "--task", "pendulum")
    assert status == 2
    assert "run 2 (30 samples" in said
    assert iolspi("demos", "check", path, "--task", "pendulum", "--run", 2)[0] == 1  # odd, but read


def test_exports_hold_the_samples(iolspi, tmp_path):
    expected = bags.read_demonstration(find("demos", "pendulum", "set_1"), TASK)
    table, arrays = tmp_path / "x.csv", tmp_path / "x.npz"
    assert iolspi("demos", "export", SET_1, "--out", table)[0] == 0
    with table.open() as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == 6300
    first = expected.samples[0].transition
    assert float(rows[0]["shaft.position"]) == first.state[0]
    assert iolspi("demos", "export", SET_1, "--out", arrays)[0] == 0
    found = np.load(arrays)
    np.testing.assert_array_equal(found["next_state"], expected.transitions().next_state)
    assert load(str(found["task"]), "file").name == "pendulum"
    assert iolspi("demos", "export", SET_1, "--out", arrays)[0] == 2
    assert iolspi("demos", "export", SET_1, "--out", tmp_path / "x.txt")[0] == 2


def test_a_plot_is_a_picture(iolspi, tmp_path):
    assert iolspi("demos", "plot", SET_1, "--out", tmp_path / "x.png")[0] == 0
    assert (tmp_path / "x.png").read_bytes()[:4] == b"\x89PNG"


def test_a_bag_that_nobody_knows_the_task_of_wants_to_be_told(iolspi, tmp_path):
    status, said = iolspi("demos", "info", write(tmp_path / "bag", samples(1)))
    assert status == 2
    assert "--task" in said


# ---------------------------------------------------------------- new-task


def test_a_new_vehicle_learns_as_it_is(iolspi, tmp_path, monkeypatch):
    assert iolspi("new-task", "my_block", "--out", tmp_path)[0] == 0
    monkeypatch.syspath_prepend(tmp_path)
    setup = prepare("my_block:MyBlock", None, 0)
    scores = []
    train(setup.world, setup.learner, 200, Listener(on_episode=lambda s, r, t: scores.append(t)))
    assert sum(scores[-20:]) <= 2  # it stays on the table
    status, said = iolspi("new-task", "my_block", "--out", tmp_path)
    assert status == 2
    assert "exists already" in said


def test_a_new_robot_and_a_new_environment_are_read(iolspi, tmp_path):
    assert iolspi("new-task", "rover", "--kind", "robot", "--out", tmp_path)[0] == 0
    assert read_robot(tmp_path / "rover.yaml").task.name == "rover"
    pytest.importorskip("gymnasium")
    assert iolspi("new-task", "swing", "--kind", "gymnasium", "--out", tmp_path)[0] == 0
    assert yaml.safe_load((tmp_path / "swing.yaml").read_text())["name"] == "swing"
    from sim_nodes.tasks import task_class

    assert task_class(str(tmp_path / "swing.yaml")).description.names[0] == "cosine"


@pytest.mark.parametrize("name", ["My-Boat", "3d", "../boat"])
def test_a_name_that_is_none_is_refused(iolspi, tmp_path, name):
    assert iolspi("new-task", name, "--out", tmp_path)[0] == 2


# ---------------------------------------------------------------- Minari, corrupt


@pytest.fixture
def datasets(tmp_path, monkeypatch):
    """Minari, with a place of its own."""
    monkeypatch.setenv("MINARI_DATASETS_PATH", str(tmp_path / "datasets"))
    return pytest.importorskip("minari")


def same(one, other):
    assert [(s.episode, s.step, s.stamp, s.source) for s in one] == [
        (s.episode, s.step, s.stamp, s.source) for s in other
    ]
    for a, b in zip(one, other, strict=True):
        np.testing.assert_equal(a.transition, b.transition)


@pytest.mark.parametrize("gap", [False, True])
def test_minari_reads_what_was_written_and_so_do_we(iolspi, tmp_path, datasets, gap):
    about = TASK
    found = bags.read_demonstration(find("demos", "pendulum", "set_1"), about)
    kept = [s for s in found.samples[:900] if not (gap and 100 <= s.step < 110)]
    bag, again = tmp_path / "bag", tmp_path / "again"
    write_bag(bag, kept, about)
    assert iolspi("demos", "export", bag, "--out", "minari:pendulum/set1-v0")[0] == 0
    theirs = datasets.load_dataset("pendulum/set1-v0")
    assert theirs.total_steps == len(kept)
    assert theirs.total_episodes == (6 if gap else 3)
    first = next(iter(theirs.iterate_episodes()))
    np.testing.assert_array_equal(first.observations[0], kept[0].transition.state)
    assert iolspi("demos", "import", "minari:pendulum/set1-v0", "--out", again)[0] == 0
    same(bags.read_demonstration(again, about).samples, kept)
    status, said = iolspi("demos", "export", bag, "--out", "minari:pendulum/set1-v0")
    assert (status, "already exists" in said) == (2, True)


def test_another_s_dataset_is_imported(iolspi, tmp_path, datasets):
    """Collected by Minari's own recorder from an environment; its actions begin at 1."""
    gymnasium = pytest.importorskip("gymnasium")
    from minari.data_collector import EpisodeBuffer

    states = np.arange(10.0).reshape(5, 2)
    buffer = EpisodeBuffer(
        id=0, observations=states, actions=np.array([1, 2, 3, 1]), rewards=[1.0, 2.0, 3.0, 4.0],
        terminations=[False] * 3 + [True], truncations=[False] * 4,
    )  # fmt: skip
    datasets.create_dataset_from_buffers(
        "their/own-v0", [buffer], action_space=gymnasium.spaces.Discrete(3, start=1),
        observation_space=gymnasium.spaces.Box(-np.inf, np.inf, (2,), np.float64),
    )  # fmt: skip
    out = tmp_path / "out"
    status, said = iolspi("demos", "import", "minari:their/own-v0", "--out", out)
    assert (status, "--task" in said) == (2, True)
    status, said = iolspi(
        "demos", "import", "minari:their/own-v0", "--out", out, "--task", "slung_load"
    )
    assert (status, "4 variables, 4 actions" in said) == (2, True)
    command = ("demos", "import", "minari:their/own-v0", "--out", out, "--task", "pendulum")
    assert iolspi(*command)[0] == 0
    found = bags.read_demonstration(out, TASK).transitions()
    np.testing.assert_array_equal(found.state, states[:-1])
    np.testing.assert_array_equal(found.next_state, states[1:])
    assert found.action.tolist() == [0, 1, 2, 0]
    assert found.terminated.tolist() == [False, False, False, True]


@pytest.mark.parametrize("gap", [False, True])
def test_lerobot_reads_what_was_written(iolspi, tmp_path, gap):
    module = pytest.importorskip(
        "lerobot.datasets.lerobot_dataset", reason="LeRobot is not installed: pip install lerobot"
    )
    task = Pendulum().description
    flown = bags.read_demonstration(Path(SET_1), task).samples[:650]
    if gap:
        del flown[100]
    write_bag(tmp_path / "bag", flown, task)
    out = tmp_path / "a.lerobot"
    assert iolspi("demos", "export", tmp_path / "bag", "--out", out)[0] == 0
    dataset = module.LeRobotDataset("local/a", root=out)
    assert (len(dataset), dataset.fps) == (len(flown), round(1 / task.sampling_time))
    assert dataset.num_episodes == 3 + gap
    exact = np.stack(dataset.hf_dataset.with_format(None)["observation.state"])
    np.testing.assert_array_equal(exact, [s.transition.state for s in flown])
    for sample, frame in zip(flown, dataset, strict=False):
        t = sample.transition
        np.testing.assert_array_equal(frame["observation.state"].numpy(), np.float32(t.state))
        assert float(frame["action"]) == task.actions[t.action].value[0]
        told = [frame[key].item() for key in ("action_index", "next.reward", "stamp", "source")]
        assert told == [t.action, np.float32(t.reward), sample.stamp, int(sample.source)]
    status, said = iolspi("demos", "export", tmp_path / "bag", "--out", out)
    assert status == 2
    assert "exists already" in said


class Failing:
    """LeRobot's library when a disk is full."""

    @classmethod
    def create(cls, *_, root, **__):
        root.mkdir()
        raise OSError(28, "No space left on device")


def test_an_export_that_fails_leaves_nothing(tmp_path, monkeypatch):
    monkeypatch.setattr(lerobot, "_library", lambda: Failing)
    monkeypatch.setattr(lerobot, "_quiet", contextlib.nullcontext)
    with pytest.raises(InputError, match="No space left"):
        lerobot.write_lerobot(
            tmp_path / "a.lerobot", bags.read_demonstration(Path(SET_1), Pendulum().description)
        )
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("name", ["minari:nothing/here-v0", "minari:../x", "here", "minari:"])
def test_a_dataset_that_is_not_there_is_refused(iolspi, tmp_path, datasets, name):
    assert iolspi("demos", "import", name, "--out", tmp_path / "out")[0] == 2
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize("g", [9.81, 5.0])
def test_corrupted_samples_are_what_the_model_does(iolspi, tmp_path, g):
    out, file = tmp_path / "out", tmp_path / "mine.yaml"
    file.write_text(find("config", "pendulum.yaml").read_text().replace("g: 9.81 ", f"g: {g} "))
    of_this = ("--share", "0.5", "--config", str(file))
    assert iolspi("demos", "corrupt", SET_1, "--out", out, *of_this)[0] == 0
    before = bags.read_demonstration(find("demos", "pendulum", "set_1"), TASK).samples
    after = bags.read_demonstration(out, TASK).samples
    changed = [s for s in after if s.source == Source.CORRUPTED]
    assert 0.45 < len(changed) / len(after) < 0.55
    model = Pendulum(g=g)
    for sample in changed[::100]:
        t = sample.transition
        expected, reward, _ = model.step(t.state, t.action)
        np.testing.assert_array_equal(t.next_state, expected)
        assert t.reward == reward
    kept = [n for n, s in enumerate(after) if s.source != Source.CORRUPTED]
    same([after[n] for n in kept], [before[n] for n in kept])
    assert iolspi("demos", "corrupt", SET_1, "--out", tmp_path / "no", "--share", "1.5")[0] == 2
