import csv
import shutil
import signal
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from iolspi_ros.bags import read_demonstration
from iolspi_ros.core.features import RBFGrid
from iolspi_ros.core.online import OnlineLSPI
from iolspi_ros.errors import InputError
from iolspi_ros.experiments.evaluate import evaluate, evaluate_weights, policy_of
from iolspi_ros.experiments.headless import Listener, train
from iolspi_ros.experiments.pendulum import HANGING, LITERAL, PendulumRun, best, learn
from iolspi_ros.experiments.pendulum_episodes import Episodes, record
from iolspi_ros.experiments.pendulum_samples import Spread, spread
from iolspi_ros.experiments.samplesets import (
    INDEPENDENT,
    MODES,
    SEQUENTIAL,
    bag,
    demonstrate,
    samples,
)  # fmt: skip
from iolspi_ros.experiments.statistics import Interval
from iolspi_ros.experiments.thesis import (
    catalogue,
    chapter9,
    chapter10,
    claims,
    compare,
    curves,
    page,
)
from iolspi_ros.experiments.thesis.claims import Verdict
from iolspi_ros.experiments.thesis.study import read_rows, write_rows
from sim_nodes.tasks.slung_load import SlungLoad
from sim_nodes.world import World, WorldSettings

COLUMNS = ("state", "action", "reward", "next_state", "terminated", "truncated")


@pytest.mark.parametrize("number", MODES)
def test_the_pilot_flies_the_shipped_sets_without_a_graph(number):
    shipped = samples(f"set {number}", HANGING, 0)
    flown = demonstrate(HANGING, *MODES[number], number)
    again = read_demonstration(bag(f"set {number}"), HANGING.description).transitions()
    for name in COLUMNS:
        np.testing.assert_array_equal(getattr(flown, name), getattr(shipped, name))
        np.testing.assert_array_equal(getattr(again, name), getattr(shipped, name))


def test_repeats_are_other_samples_of_the_same_kind():
    first, repeat = samples("set 5", HANGING, 0), samples("set 5a", HANGING, 0)
    assert len(first) == len(repeat) == 6300
    assert not np.array_equal(first.action, repeat.action)
    np.testing.assert_array_equal(repeat.action, samples("set 5a", HANGING, 7).action)


def test_random_samples_are_whole_episodes_or_cover_all_states():
    whole = samples(SEQUENTIAL, HANGING, 3)
    assert len(whole) == 21 * 300
    assert whole.truncated.sum() == 21
    assert np.bincount(whole.action).min() > 1900
    apart = samples(INDEPENDENT, HANGING, 3)
    assert len(apart) == 21 * 300
    quarters = np.histogram2d(*apart.state.T, bins=4)[0]
    assert quarters.min() > 300  # 394 on average
    following, reward, _ = HANGING.step(apart.state[9], int(apart.action[9]))
    np.testing.assert_allclose(apart.next_state[9], following, rtol=1e-12)
    assert apart.reward[9] == pytest.approx(reward)


def test_an_unknown_sample_set_names_the_known_ones():
    with pytest.raises(InputError, match="'set 9'; allowed: nothing, random sequential"):
        samples("set 9", HANGING, 0)


@pytest.mark.slow
def test_a_policy_is_judged_at_the_time_it_is_in_use():
    """Updates after 5 and 10 s; at 7.5 s the first one's policy flies."""
    found = learn(PendulumRun(samples="set 5", seconds=12.0, looks=8), 0)
    core = OnlineLSPI(HANGING.description, LITERAL, np.random.default_rng([0, 1]))
    core.pretrain(samples("set 5", HANGING, 0))
    policies = [core.weights]
    world = World(HANGING, WorldSettings(), np.random.default_rng([0, 0]))
    train(world, core, 8, Listener(on_update=lambda update: policies.append(core.weights)))
    flown = [evaluate(HANGING, policy_of(w, core.features)).discounted_return for w in policies]
    assert found["time"].tolist() == [0.0, 1.5, 3.0, 4.5, 6.0, 7.5, 9.0, 10.5, 12.0]
    expected = [flown[0]] * 4 + [flown[1]] * 3 + [flown[2]] * 2
    np.testing.assert_allclose(found["discounted"], expected, rtol=1e-6)
    assert found["score"].shape == (8,)


@pytest.mark.parametrize("task", [HANGING, replace(HANGING, g=15.0, initial="distributed")])
def test_the_compiled_judge_flies_as_the_plain_one(task):
    features = LITERAL.resolve(HANGING.description).features()
    weights = np.random.default_rng(5).standard_normal((3, features.size))
    plain = evaluate(task, policy_of(weights, features), 7.0)
    compiled = evaluate_weights(task, weights, features, 7.0)
    np.testing.assert_allclose(compiled.states, plain.states, atol=1e-6)
    np.testing.assert_array_equal(compiled.actions, plain.actions)
    np.testing.assert_allclose(compiled.discounted, plain.discounted, rtol=1e-9)
    np.testing.assert_allclose(compiled.score, plain.score, rtol=1e-9)


def test_the_compiled_judge_knows_where_an_episode_ends():
    task = SlungLoad()
    features = RBFGrid(task.description.low, task.description.high, (3, 3, 3, 3))
    weights = np.random.default_rng(1).standard_normal((4, features.size))
    plain = evaluate(task, policy_of(weights, features))
    compiled = evaluate_weights(task, weights, features)
    np.testing.assert_allclose(compiled.states, plain.states, atol=1e-6)
    np.testing.assert_array_equal(compiled.actions, plain.actions)
    np.testing.assert_allclose(compiled.discounted, plain.discounted, rtol=1e-9)
    np.testing.assert_array_equal(compiled.ending, plain.ending)
    assert len(set(compiled.ending.tolist())) > 1


def test_the_yardstick_takes_the_g_of_each_time():
    jump = replace(HANGING, g_after=19.81, g_change_start=3.0)
    found = best(PendulumRun(task=jump, seconds=6.0, looks=2), 0)["discounted"]
    assert found[1] == found[2] < found[0] == pytest.approx(-1321, rel=0.002)


def test_quick_settings_keep_the_order_of_things():
    jump = PendulumRun(task=replace(HANGING, g_change_start=300.0, g_change_duration=200.0))
    quick = jump.quick()
    task = quick.task
    assert task.g_change_start / quick.seconds == 0.5
    assert task.g_change_duration / quick.seconds == pytest.approx(1 / 3)
    assert len(quick.times) < len(jump.times)


def test_recorded_episodes_are_those_of_the_learning_run():
    setting = PendulumRun(LITERAL, samples="set 5", seconds=15.0, looks=1)
    found = record(Episodes(setting, ((600.0, -2, 2),)), 4)
    assert found["episode"].tolist() == [8, 9]
    assert found["angle"].shape == (2, 301)
    np.testing.assert_allclose(found["reward"].sum(axis=1), learn(setting, 4)["score"][-2:])
    up = np.abs(found["angle"]) <= np.pi / 12
    steps = np.where(up.any(axis=1), up.argmax(axis=1), np.nan)
    np.testing.assert_allclose(found["reached"], steps * 0.005)


def test_spread_is_measured():
    found = spread(Spread(INDEPENDENT), 0)
    assert found["above"] == pytest.approx(0.5, abs=0.03)
    assert found["streak"] == pytest.approx(1.5, abs=0.05)  # geometric, of three actions
    assert found["visited"] > 0.95


def test_table_9_1_to_its_digits():
    rows = chapter9._table({})
    printed = [0.9977, 0.99954, 0.99977, 0.999885, 0.999954, 0.999977, 0.999985]
    assert [float(row["leaving_10_percent"]) for row in rows] == printed
    by_equation = [float(row["equation_9_13_leaving_1_percent"]) for row in rows]
    assert by_equation == pytest.approx([0.01 ** (1 / row["samples"]) for row in rows], abs=5e-7)
    study = catalogue.studies()["table9-1"]
    verdicts = [claims.verdict(claim.decide({})) for claim in study.claims]
    assert verdicts == [Verdict.REPRODUCED, Verdict.NOT]


@pytest.mark.parametrize(
    ("finding", "expected"),
    [
        (claims.above("x", Interval(2.0, 1.0, 3.0)), Verdict.REPRODUCED),
        (claims.above("x", Interval(2.0, -1.0, 5.0)), Verdict.PARTLY),
        (claims.above("x", Interval(-2.0, -3.0, -1.0)), Verdict.NOT),
        (claims.below("x", Interval(2.0, 1.0, 3.0), 4.0), Verdict.REPRODUCED),
        (claims.below("x", Interval(2.0, 1.0, 3.0), 2.5), Verdict.PARTLY),
        (claims.within("x", Interval(0.0, -1.0, 1.0), -2.0, 2.0), Verdict.REPRODUCED),
        (claims.within("x", Interval(2.0, 1.0, 3.0), -2.0, 2.0), Verdict.PARTLY),
        (claims.within("x", Interval(4.0, 3.0, 5.0), -2.0, 2.0), Verdict.NOT),
        (claims.above("x", Interval(np.nan, np.nan, np.nan)), Verdict.PARTLY),
    ],
)
def test_an_interval_decides(finding, expected):
    assert finding.verdict is expected


def test_a_claim_is_partly_reproduced_when_its_parts_differ():
    yes, no = claims.above("x", Interval(1, 1, 1)), claims.above("x", Interval(-1, -1, -1))
    assert claims.verdict([yes, yes]) is Verdict.REPRODUCED
    assert claims.verdict([no, no]) is Verdict.NOT
    assert claims.verdict([yes, no]) is Verdict.PARTLY


def curve(values):
    """A cell of a 600 s run whose curve takes these values at equal times."""
    values = np.array(values, float)
    time = np.tile(np.linspace(0.0, 600.0, values.shape[1]), (len(values), 1))
    return {"time": time, "discounted": values, "score": values.repeat(8, axis=1)}


def test_curves_are_compared_by_seed_over_a_stretch_of_time():
    noise = np.random.default_rng(0).normal(0.0, 50.0, (20, 1))
    low = noise + np.array([[-1400.0, -1300.0, -1300.0]])
    data = {"low": curve(low), "high": curve(low + np.array([[0.0, 10.0, 20.0]]))}
    (gain,) = compare.higher("high", "low", "discounted", (300.0, 600.0))(data)
    assert gain.verdict is Verdict.REPRODUCED
    assert gain.measured == pytest.approx((15.0, 15.0, 15.0))
    (start,) = compare.higher("high", "low", "discounted", (0.0, 0.0))(data)
    assert start.measured.mean == 0.0
    (same,) = compare.similar("high", "low", "discounted", (600.0, 600.0), 0.02)(data)
    assert same.verdict is Verdict.REPRODUCED  # 20 of 1300
    (up,) = compare.rises("low", "discounted", (0.0, 0.0), (300.0, 600.0))(data)
    assert up.measured.mean == pytest.approx(100.0)


def test_how_much_sooner_a_score_is_reached():
    """One rises at half of the run, the other at three quarters: 150 s, less the window of 20."""
    n = 400
    rise = lambda at: np.where(np.arange(n) < at, -3000.0, -1000.0) * np.ones((3, 1))  # noqa: E731
    data = {"a": {"time": curve([[0, 0]] * 3)["time"], "score": rise(200)},
            "b": {"time": curve([[0, 0]] * 3)["time"], "score": rise(300)}}  # fmt: skip
    (a,), (b,) = (compare.sooner(x, "b", 0.0, 100.0)(data) for x in "ab")
    assert a.measured.mean - b.measured.mean == pytest.approx(150.0)
    assert b.measured.mean == pytest.approx(600.0 - 1.5 * 320, abs=2.0)


def test_scores_are_averaged_over_four_episodes():
    cell = {"time": curve([[0.0, 0.0]])["time"], "score": np.arange(8.0)[None, :]}
    rows = curves.scores({"a": cell})
    assert [row["mean"] for row in rows] == [1.5, 5.5]
    assert [row["x"] for row in rows] == [150.0, 450.0]


def test_rows_survive_a_file(tmp_path):
    rows = [{"curve": "a, b", "x": 1.0, "n": 3}, {"curve": "ε", "x": 1 / 3, "n": 4}]
    write_rows(tmp_path / "rows.csv", rows)
    found = read_rows(tmp_path / "rows.csv")
    assert found == [
        {"curve": "a, b", "x": "1", "n": "3"}, {"curve": "ε", "x": "0.333333", "n": "4"}
    ]  # fmt: skip


def test_every_study_can_be_thinned_and_says_where_it_stands():
    for study in catalogue.studies().values():
        assert study.where
        assert study.title
        labels = [cell.label for cell in study.cells]
        assert len(set(labels)) == len(labels), study.name
        for cell in study.thinned(5, True).cells:
            assert 1 <= cell.seeds <= 5
        for claim in study.claims:
            assert claim.text
            assert claim.where
            assert claim.setting


def run(*arguments):
    command = [sys.executable, "-m", "iolspi_ros", "reproduce", *map(str, arguments)]
    return subprocess.run(command, capture_output=True, text=True, timeout=170)


def test_an_unknown_figure_names_the_known_ones():
    done = run("fig99")
    assert done.returncode == 2
    assert "figure or table 'fig99' is unknown; allowed: fig2, fig3" in done.stderr


@pytest.mark.slow
def test_one_figure_end_to_end(tmp_path):
    """The quick form, thinner still: exploring much scores badly while learning."""
    done = run("fig3", "--quick", "--realisations", 3, "--out", tmp_path)
    assert done.returncode == 0, done.stderr
    with (tmp_path / "thesis" / "claims.csv").open(encoding="utf-8") as file:
        found = {row["claim"]: row for row in csv.DictReader(file)}
    scores = found["A high exploration rate yields low learning scores"]
    assert scores["verdict"] == "reproduced"
    assert scores["realisations"] == "3"
    assert (tmp_path / "thesis" / "fig3.png").stat().st_size > 10_000
    page = (tmp_path / "thesis.md").read_text(encoding="utf-8")
    assert "| reproduced |" in page
    assert "thesis/fig3.png" in page
    again = run("fig3", "--quick", "--realisations", 3, "--out", tmp_path)
    assert "realisations took" in done.stdout
    assert "realisations took" not in again.stdout


def test_an_interrupted_command_goes_on_where_it_stopped(tmp_path):
    data = tmp_path / "data"
    command = [sys.executable, "-m", "iolspi_ros", "reproduce", "table1", "--processes", "1",
               "--realisations", "6", "--out", str(tmp_path)]  # fmt: skip
    process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    try:
        end = time.monotonic() + 60.0
        while len(list(data.rglob("*.npz"))) < 3:
            assert time.monotonic() < end, "nothing was computed"
            assert process.poll() is None, process.stderr.read()
            time.sleep(0.01)
        process.send_signal(signal.SIGINT)
        said, complaint = process.communicate(timeout=60.0)
    finally:
        process.kill()
    assert process.returncode == 130
    assert "what was computed is kept" in said
    assert "Traceback" not in complaint
    kept = {path: path.stat().st_mtime_ns for path in data.rglob("*.npz")}
    assert 3 <= len(kept) < 42
    done = run(*command[4:])
    assert f"{42 - len(kept)} realisations took" in done.stdout
    assert all(path.stat().st_mtime_ns == stamp for path, stamp in kept.items())
    claims = (tmp_path / "thesis" / "claims.csv").read_text(encoding="utf-8")
    assert claims.count("reproduced") >= 2


DOCS = Path(__file__).parent.parent / "docs"


def test_the_page_in_docs_is_made_from_the_rows_beside_it(tmp_path):
    """Figures too; of those, the cheapest of each kind."""
    folder = tmp_path / "thesis"
    shutil.copytree(DOCS / "thesis", folder, ignore=shutil.ignore_patterns("*.png"))
    known = catalogue.studies()
    assert {path.stem for path in folder.glob("*.csv")} == {*known, Path(page.CLAIMS).stem}
    written = page.write(list(known.values()), folder).read_text(encoding="utf-8")
    committed = (DOCS / "thesis.md").read_text(encoding="utf-8")

    def without_versions(text):
        return [line.split("Computed with")[0] for line in text.splitlines()]

    assert without_versions(written) == without_versions(committed)
    for name in ("fig10", "fig6", "fig16"):
        page.draw(known[name], folder)
        assert (folder / f"{name}.png").stat().st_size > 5_000
    for name, study in known.items():
        assert (study.draw is None) or (DOCS / "thesis" / f"{name}.png").is_file()


def test_at_least_thirty_claims_of_the_thesis_are_decided():
    rows = read_rows(DOCS / "thesis" / page.CLAIMS)
    said = [row for row in rows if row["where"] != claims.OURS]
    decided = {row["claim"] for row in rows}
    assert decided == {c.text for s in catalogue.studies().values() for c in s.claims}
    assert len(said) >= 30
    assert {row["verdict"] for row in rows} <= {verdict.value for verdict in Verdict}
    for row in said:
        assert row["verdict"] == "reproduced" or row["why"], row["claim"]


@pytest.mark.parametrize("n", [2, 3, 5, 100])
def test_bounds_are_narrower_with_more_realisations(n):
    """σ / √n: a tenth of them has bounds √10 times as wide."""
    score = np.random.default_rng(3).normal(-4000.0, 300.0, (n, 200))
    found = chapter9._widths({"online LSPI": {"score": score}})
    assert len(found) >= 1
    if n == 100:
        whole = found[-2]
        assert whole.measured.mean == pytest.approx(1 / np.sqrt(10), rel=0.2)
        assert all(finding.verdict is Verdict.REPRODUCED for finding in found)


def test_constant_g_is_constant():
    """Figs. 10-14 and 10-15."""
    cells = catalogue.studies()["fig10-14"].cells
    constant = {c.label: c.setting.task for c in cells if c.label in chapter10.GRAVITIES}
    assert set(constant) == set(chapter10.GRAVITIES)
    for label, task in constant.items():
        assert {task.gravity(t) for t in (0.0, 299.0, 450.0)} == {chapter10.GRAVITIES[label]}
