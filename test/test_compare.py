"""`iolspi compare`: what is measured, kept and said."""

import csv
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from figure_checks import check

from iolspi_ros import figures
from iolspi_ros.errors import InputError
from iolspi_ros.experiments import compare
from iolspi_ros.experiments import life as lives
from iolspi_ros.experiments.headless import Listener, prepare, train
from iolspi_ros.experiments.results import Store
from iolspi_ros.experiments.thesis.study import read_rows
from iolspi_ros.methods.traits import TRAITS
from iolspi_ros.report import comparison, curves, measures


def life(task, learner, **more):
    case = compare.plan(task, [learner], 1, more.pop("seconds", None), False)[0]
    return case.cells[learner].setting


def test_a_life_is_what_training_is_step_by_step():
    """The same draws as `iolspi learn`: the same rewards, episode by episode."""
    setting = life("pendulum", "q_learning", seconds=7.5)
    found = lives.learn(setting, 3)
    from iolspi_ros import resources

    world, core, _ = prepare("pendulum", resources.config("pendulum"), 3, "q_learning")
    scores = []
    train(world, core, 5, Listener(lambda *_: None, on_episode=lambda s, *_: scores.append(s)))
    assert found["rewards"][-1] == pytest.approx(sum(scores))
    assert found["endings"][-1].tolist() == [5]
    assert (np.diff(found["processor"]) >= 0.0).all()
    again = lives.learn(setting, 3)
    for name in ("discounted", "success", "rewards", "endings"):
        np.testing.assert_array_equal(found[name], again[name])


@pytest.mark.parametrize(("options", "words"), [
    (["--algorithms", "kite"], "learner is 'kite'; allowed:"),
    (["--algorithms", " , "], "allowed: all, or names with commas between"),
    (["--algorithms", "apprentice", "--task", "cart_pole"], "no demonstrations are shipped"),
    (["--task", "gymnasium:CartPole-v1"], "a task whose class is a dataclass of its settings"),
    (["--algorithms", "continuous_value_iteration", "--task", "slung_load"], "allowed for this"),
])  # fmt: skip
def test_what_cannot_be_compared_is_said(tmp_path, options, words):
    command = [sys.executable, "-m", "iolspi_ros", "compare", "--out", str(tmp_path / "out")]
    ended = subprocess.run(
        [*command, *options], capture_output=True, text=True, timeout=90, check=False
    )
    assert ended.returncode == 2
    assert words.lower() in ended.stderr.lower()
    assert "Traceback" not in ended.stderr
    assert not (tmp_path / "out").exists()


def test_what_is_near():
    near = measures._near
    returns, success = np.array([-103.0, -102.0, -99.0]), np.array([0.0, 0.0, 1.0])
    assert near(returns, success, np.full(3, -100.0)).tolist() == [False, True, True]
    assert near(returns, success, np.zeros(3)).tolist() == [False, False, True]
    assert not near(returns, success, np.full(3, np.nan)).any()  # nobody knows
    assert measures.first_near(np.array([False, True, False, True, True])) == 3
    assert measures.first_near(np.array([False, True])) is None


def test_time_after_a_jump_is_counted_from_it(tmp_path):
    case = next(c for c in compare.plan("pendulum", ["q_learning"], 1, 20.0, False)
                if c.name == compare.JUMP_CASE)  # fmt: skip
    cell, store = case.cells["q_learning"], Store(tmp_path)
    looks = len(cell.setting.times)
    assert cell.setting.times[-1] == 40.0
    assert case.jump == 20.0
    time = cell.setting.times
    returns = np.where(time < 24.0, -100.0, -200.0)  # near the old optimum, then near the new one
    store.write(cell, 0, {
        "time": time, "discounted": returns, "success": np.ones(looks),
        "processor": time, "rewards": -time, "endings": np.arange(looks)[:, None],
    })  # fmt: skip
    store.write(case.best, 0, {"discounted": np.array([-100.0, -200.0])})
    (row,), seen = measures.measured(case, store)
    assert row["time"] == 4.0
    assert row["score"] == -1.0
    assert row["crashes"] == 0.0  # a time-out is none
    assert [c["best"] for c in seen if c["time"] in (19.0, 20.0)] == [-100.0, -200.0]


def test_crashes_are_counted_until_most_starts_succeed(tmp_path):
    case = compare.plan("slung_load", ["q_learning"], 1, 20.0, False)[0]
    cell, store = case.cells["q_learning"], Store(tmp_path)
    time = cell.setting.times
    looks = len(time)
    endings = np.zeros((looks, 5), int)
    endings[:, 1], endings[:, 3], endings[:, 4] = 7, np.arange(looks), 1  # dunks, cable, wall
    success = np.where(time < 8.0, 0.1, 0.85)
    success[2] = 0.9  # once, by chance
    store.write(cell, 0, {"time": time, "discounted": -time, "success": success,
                          "processor": time, "rewards": time, "endings": endings})  # fmt: skip
    store.write(case.best, 0, {"discounted": np.array([50.0, 50.0])})
    (row,), _ = measures.measured(case, store)
    assert row["crashes_until"] == 8 + 1
    assert row["crashes"] == looks - 1 + 1
    assert (row["reached"], row["safe"]) == (0, 1)


def test_who_cannot_be_in_a_case_is_said():
    alone, shown, jump = compare.plan("pendulum", ["sarsa", "apprentice"], 2, None, False)
    assert (alone.cells["apprentice"], shown.cells["sarsa"]) == (None, None)
    assert jump.cells["sarsa"].setting.samples == "nothing"
    assert jump.cells["apprentice"].setting.samples == "set 5"


def test_who_cannot_learn_a_task_is_refused_by_name_and_else_left_out():
    with pytest.raises(InputError, match="continuous_value_iteration needs three"):
        compare.plan("slung_load", ["continuous_value_iteration"], 1, None, False)
    cases = compare.plan("slung_load", ["continuous_value_iteration", "sarsa"], 1, None, True)
    assert list(cases[0].cells) == ["sarsa"]


def test_the_deep_one_says_which_extra_it_needs(monkeypatch):
    monkeypatch.setitem(sys.modules, "stable_baselines3", None)
    with pytest.raises(InputError, match=r"dqn needs stable_baselines3.*extra 'deep'"):
        compare.plan("pendulum", ["dqn"], 1, None, False)
    assert list(compare.plan("pendulum", ["dqn", "sarsa"], 1, None, True)[0].cells) == ["sarsa"]


@pytest.mark.slow
def test_the_deep_one_lives_the_same_life():
    pytest.importorskip("stable_baselines3")
    setting = life("cart_pole", "dqn", seconds=60.0)
    found = compare.realisation("dqn")(setting, 0)
    assert found["discounted"].shape == (lives.LOOKS + 1,)
    assert found["endings"][-1, 1] > 10  # it falls often at first
    assert found["rewards"][-1] == -found["endings"][-1, 1]


@pytest.mark.parametrize(
    ("arguments", "error"),
    [
        (("--learners", "iolspi,nobody"), "learner is 'nobody'; allowed: apprentice"),
        (("--learners", " , "), "allowed: all, or names with commas between"),
        (("--task", "tetris"), "task is 'tetris'; allowed:"),
        (("--seconds", "0.01"), "seconds is 0.01; allowed: 0.1 or more"),
        (("--backend", "dask"), "--backend dask and --scheduler ADDRESS go together"),
    ],
)
def test_bad_input_is_said_in_a_line(arguments, error, tmp_path, monkeypatch, capsys):
    from iolspi_ros import cli

    monkeypatch.setattr(sys, "argv", ["iolspi", "compare", *arguments, "--out", str(tmp_path)])
    assert cli.main() == 2
    assert error in capsys.readouterr().err


def test_the_command_keeps_rows_pictures_and_a_page_and_goes_on(tmp_path, monkeypatch, capsys):
    from iolspi_ros import cli

    words = [
        "iolspi", "compare", "--learners", "sarsa,automata", "--seeds", "2", "--seconds", "1.5",
        "--processes", "1", "--out", str(tmp_path),
    ]  # fmt: skip
    monkeypatch.setattr(sys, "argv", words)
    with pytest.raises(SystemExit) as ended:
        cli.main()
    assert ended.value.code == 0
    kept = {path: path.stat().st_mtime_ns for path in tmp_path.glob("data/*/*.npz")}
    assert len(kept) == 2 * 4 + 2  # two of each in two cases, and the near-optimal ones
    capsys.readouterr()
    with pytest.raises(SystemExit):
        cli.main()
    assert "realisations" not in capsys.readouterr().out  # nothing was left to compute
    assert {path: path.stat().st_mtime_ns for path in kept} == kept
    with (tmp_path / "methods" / "table.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert [row["learner"] for row in rows] == ["sarsa", "automata"] * 3
    page = (tmp_path / "report.html").read_text()
    assert comparison.CHOOSE["automata"] in page
    assert "data:image/png;base64" in page
    document = (tmp_path / "methods" / "measured.md").read_text()
    assert "](pendulum-returned.png)" in document
    assert "cannot" in document
    assert (tmp_path / "methods" / "pendulum-returned.png").is_file()


def test_each_learner_has_its_sentence():
    assert set(comparison.CHOOSE) == set(TRAITS)
    assert all(
        text.startswith("When ") and text.endswith(".") for text in comparison.CHOOSE.values()
    )


def drawn(learners):
    """Curves of several learners, made up."""
    rng = np.random.default_rng(0)
    time = np.linspace(0.0, 60.0, 21)
    rows = []
    for case in compare.CASES:
        for learner in learners:
            returns = -1300.0 - 400.0 * rng.random() * np.exp(-time / 20.0)
            rows += [
                {
                    "task": "pendulum", "case": case, "learner": learner, "time": t,
                    "processor": t / 9, "best": -1300.0, "crashes": t // 9,
                    "returned": r, "returned_low": r - 20.0, "returned_high": r + 20.0,
                    "success": 0.5, "success_low": 0.4, "success_high": 0.6,
                }
                for t, r in zip(time, returns, strict=True)
            ]  # fmt: skip
    return rows


@pytest.mark.parametrize("learners", [list(TRAITS), ["iolspi", "sarsa"]])
@pytest.mark.parametrize("kind", curves.PICTURES)
def test_pictures_can_be_read(kind, learners):
    figure = curves.picture(drawn(learners), "pendulum", kind)
    check(figure)
    assert figures.alt(figure)


def test_a_picture_of_no_crashes_is_left_out():
    rows = [row | {"crashes": 0} for row in drawn(["iolspi"])]
    assert curves.picture(rows, "pendulum", "crashes") is None


DOCS = Path(__file__).parent.parent / "docs" / "methods"


def test_the_tables_committed_are_those_of_the_rows_committed():
    table = read_rows(DOCS / "table.csv")
    text = (DOCS / "measured.md").read_text(encoding="utf-8")
    for lines in (comparison.overview(table), comparison.details(table)):
        assert "\n".join(comparison._markdown(lines)) in text
    for words, file in re.findall(r"!\[([^]]*)\]\(([^)]*)\)", text):
        assert len(words) > 30
        assert (DOCS / file).is_file()
