"""The task as data: what is written is read again, and what is wrong is named."""

import json
import math
from dataclasses import fields, replace

import numpy as np
import pytest
import yaml
from hypothesis import given
from hypothesis import strategies as st

from iolspi_ros import task as tasks
from iolspi_ros.errors import InputError
from iolspi_ros.task import Action, Ending, TaskDescription, Variable
from iolspi_ros.task.plain import LARGEST, LARGEST_YAML
from sim_nodes.tasks.cart_pole import CartPole
from sim_nodes.tasks.pendulum import Pendulum
from sim_nodes.tasks.slung_load import SlungLoad

numbers = st.floats(-1e6, 1e6)
words = st.text(st.characters(exclude_categories=["Cs"]), min_size=1, max_size=12)
names = st.from_regex(r"[a-z][a-z0-9_]{0,8}(\.[a-z]{1,8})?", fullmatch=True).filter(
    lambda name: name not in ("episode", "step", "sec", "nanosec", "action", "reward", "source",
                              "terminated", "truncated") and not name.startswith("next.")
)  # fmt: skip


@st.composite
def limits(draw):
    low, high = sorted(draw(st.lists(numbers, min_size=2, max_size=2, unique=True)))
    ends = draw(st.sampled_from(["both", "low", "high", "none", "periodic"]))
    return (
        low if ends in ("both", "low", "periodic") else -math.inf,
        high if ends in ("both", "high", "periodic") else math.inf,
        ends == "periodic",
    )


@st.composite
def descriptions(draw):
    variables = tuple(
        Variable(name, draw(words), *draw(limits()), label=draw(words))
        for name in draw(st.lists(names, min_size=1, max_size=5, unique=True))
    )
    width = draw(st.integers(0, 3))
    actions = tuple(
        Action(name, tuple(draw(st.lists(numbers, min_size=width, max_size=width))))
        for name in draw(st.lists(words, min_size=1, max_size=5, unique=True))
    )
    endings = tuple(
        Ending(name, draw(st.none() | numbers), draw(st.booleans()))
        for name in draw(st.lists(words, min_size=1, max_size=4, unique=True))
    )
    known = [variable.name for variable in variables]
    return TaskDescription(
        name=draw(words),
        variables=variables,
        actions=actions,
        sampling_time=draw(st.floats(1e-4, 10.0)),
        neutral=draw(st.integers(0, len(actions) - 1)),
        episode_steps=draw(st.integers(1, 10**9)),
        gamma=draw(st.floats(0.0, 0.999)),
        endings=endings,
        success=draw(words),
        action_unit=draw(words),
        map_variables=tuple(known[:2]) if len(known) > 1 and draw(st.booleans()) else (),
        version=draw(st.integers(0, 2**31)),
    )


@given(descriptions())
def test_what_is_written_is_read_again_as_json_and_as_yaml(task):
    text = tasks.dump(task)
    assert tasks.load(text, "here") == task
    assert tasks.load(yaml.safe_dump(json.loads(text)), "here") == task
    assert task.differences(tasks.load(text, "here")) == []


@pytest.mark.parametrize("task", [Pendulum, SlungLoad, CartPole])
def test_the_shipped_tasks_travel(task, tmp_path):
    path = tmp_path / "task.yaml"
    path.write_text(tasks.dump(task.description))
    assert tasks.read(path) == task.description


@pytest.mark.parametrize("task", [Pendulum, SlungLoad, CartPole])
def test_the_shipped_tasks_are_states_of_joints(task):
    about = task.description
    assert about.names == tuple(
        f"{joint}.{what}" for joint in about.joints for what in ("position", "velocity")
    )


SMALL = {
    "name": "cup",
    "variables": [{"name": "level", "low": 0.0, "high": 1.0}, {"name": "flow"}],
    "actions": [{"name": "wait"}, {"name": "pour"}],
    "sampling_time": 0.5,
}


def with_(path, value):
    """SMALL with something else at a place such as ("variables", 0, "low")."""
    content = json.loads(json.dumps(SMALL))
    part = content
    for step in path[:-1]:
        part = part[step]
    part[path[-1]] = value
    return content


def without(*names):
    return {name: value for name, value in SMALL.items() if name not in names}


@pytest.mark.parametrize(
    ("content", "words"),
    [
        ([], r"the task is \[\]; allowed: names and values"),
        (7, "the task is 7; allowed: names and values"),
        (without("name"), "the task has no name; it must have one"),
        (without("variables"), "the task has no variables; it must have one"),
        (without("sampling_time"), "the task has no sampling_time"),
        (SMALL | {"colour": 1}, "the task has 'colour'; allowed: name, variables, actions"),
        (SMALL | {"name": 5}, "name of the task is 5; allowed: a text"),
        (SMALL | {"name": ""}, "name of the task is ''; allowed: a word"),
        (SMALL | {"variables": []}, r"number of variables is 0; allowed: \[1, 1000\]"),
        (SMALL | {"variables": "level"}, "variables is 'level'; allowed: a list"),
        (SMALL | {"variables": ["level"]}, "variable 0 is 'level'; allowed: names and values"),
        (with_(("variables", 0, "name"), "next.x"), "name of a variable is 'next.x'; allowed: let"),
        (with_(("variables", 0, "name"), "reward"), "name of a variable is 'reward'; allowed"),
        (with_(("variables", 0, "name"), "a,b"), "name of a variable is 'a,b'; allowed: letters"),
        (with_(("variables", 0, "name"), "4x"), "name of a variable is '4x'; allowed: letters"),
        (with_(("variables", 1, "name"), "level"), "variables have 'level' twice; allowed: each"),
        (with_(("variables", 0, "low"), 1.0), "low and high of variable level are 1.0 and 1.0"),
        (with_(("variables", 0, "low"), math.nan), "low of .* is nan; allowed: a number"),
        (with_(("variables", 0, "low"), "0"), "low of .* is '0'; allowed: a number"),
        (with_(("variables", 0, "low"), True), "low of .* is True; allowed: a number"),
        (with_(("variables", 1, "periodic"), True), "flow is periodic .* allowed: two finite"),
        (with_(("variables", 0, "periodic"), 1), "periodic of variable level is 1; allowed: true"),
        (SMALL | {"actions": []}, r"number of actions is 0; allowed: \[1, 1000\]"),
        (with_(("actions", 0, "name"), ""), "name of an action is ''; allowed: a word"),
        (with_(("actions", 0, "name"), "pour"), "actions have 'pour' twice; allowed: each name"),
        (with_(("actions", 0, "value"), [1.0]), r"values of the actions have \[0, 1\] entries"),
        (with_(("actions", 0, "value"), ["x"]), "value of action wait is 'x'; allowed: a number"),
        (SMALL | {"actions": [{"name": "a", "value": [math.nan]}]}, "value of action a is .*nan"),
        (SMALL | {"neutral": 2}, r"neutral is 2; allowed: \[0, 1\]"),
        (SMALL | {"neutral": -1}, r"neutral is -1; allowed: \[0, 1\]"),
        (SMALL | {"neutral": 0.5}, "neutral of the task is 0.5; allowed: an integer"),
        (SMALL | {"sampling_time": 0.0}, r"sampling_time is 0.0; allowed: \(0"),
        (SMALL | {"sampling_time": math.inf}, "sampling_time .* is inf; allowed"),
        (SMALL | {"sampling_time": math.nan}, "sampling_time .* is nan; allowed"),
        (SMALL | {"gamma": 1.0}, r"gamma is 1.0; allowed: \[0.0, 1.0\)"),
        (SMALL | {"episode_steps": 0}, r"episode_steps is 0; allowed: \[1"),
        (SMALL | {"endings": []}, r"number of endings is 0; allowed: \[1, 100\]"),
        (SMALL | {"endings": [{"name": "e", "success": "yes"}]}, "success of ending e is 'yes'"),
        (SMALL | {"map_variables": ["level"]}, r"map_variables is \['level'\]; allowed: two of le"),
        (SMALL | {"map_variables": ["level", "x"]}, "allowed: two of level, flow"),
        (SMALL | {"version": -1}, r"version is -1; allowed: \[0"),
    ],
)  # fmt: skip
def test_what_is_wrong_is_named_with_its_value_and_what_is_allowed(content, words):
    for text in (json.dumps(content), yaml.safe_dump(content)):
        with pytest.raises(InputError, match=f"^here: .*{words}"):
            tasks.load(text, "here")


NESTED = "a: " + "[" * 40 + "]" * 40


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", "the task is None; allowed: names and values"),
        ("]:", "here is no YAML"),
        ("{", "here is no YAML"),
        (
            "x" * (LARGEST_YAML + 1),
            f"{LARGEST_YAML + 1} characters; allowed: at most {LARGEST_YAML}",
        ),
        ("{" + "x" * LARGEST, f"{LARGEST + 1} characters; allowed: at most {LARGEST}"),
        ("a: &a [1]\nb: *a", "it has an anchor or an alias; allowed: none"),
        ("a: &a [x,x]\nb: &b [*a,*a]\nc: [*b,*b]", "it has an anchor or an alias; allowed: none"),
        (NESTED, "it is nested deeper than 20"),
        ("[" * 100_000, "here has 100000 characters"),
        ('{"a": ' + "[" * 100_000, "here is no YAML"),
        ("name: !!python/object/apply:os.getcwd []", "here is no YAML"),
        ("a\x00b: 1", "here is no YAML"),
    ],
)
def test_texts_that_mean_harm_are_refused(text, words):
    with pytest.raises(InputError, match=words):
        tasks.load(text, "here")


def test_a_file_is_read_or_named(tmp_path):
    with pytest.raises(InputError, match=r"none.yaml does not exist; allowed: a YAML file"):
        tasks.read(tmp_path / "none.yaml")
    (tmp_path / "bytes.yaml").write_bytes(b"\xff\xfe\x00")
    with pytest.raises(InputError, match=r"bytes.yaml cannot be read"):
        tasks.read(tmp_path / "bytes.yaml")
    (tmp_path / "large.yaml").write_text("x" * (LARGEST_YAML + 5))
    with pytest.raises(InputError, match="allowed: at most"):
        tasks.read(tmp_path / "large.yaml")


CUP = tasks.load(json.dumps(SMALL), "")


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"name": "mug"}, ["name is 'cup' here and 'mug' there"]),
        ({"sampling_time": 0.25}, ["sampling_time is 0.5 here and 0.25 there"]),
        ({"gamma": 0.5}, ["gamma is 0.98 here and 0.5 there"]),
        ({"neutral": 1}, ["neutral is 0 here and 1 there"]),
        ({"episode_steps": 3}, ["episode_steps is 1000 here and 3 there"]),
        ({"version": 2}, ["version is 1 here and 2 there"]),
        ({"action_unit": "l"}, ["action_unit is '' here and 'l' there"]),
        ({"actions": (Action("wait"),)}, ["actions is [[], []] here and [[]] there"]),
        (
            {"endings": (Ending("time-out"), Ending("spilt", -1.0))},
            ["endings is [(None, False), (None, False)] here and [(None, False), (-1.0, False)] "
             "there"],
        ),
        (
            {"variables": (Variable("level", "m", 0.0, 2.0), Variable("flow"))},
            ["unit of level is '' here and 'm' there", "high of level is 1.0 here and 2.0 there"],
        ),
    ],
)  # fmt: skip
def test_a_difference_shows_both_sides(change, words):
    other = replace(CUP, **change)
    assert CUP.differences(other) == words
    with pytest.raises(InputError) as said:
        CUP.check_same(other, "the file", "the vehicle")
    assert "the task of the vehicle contradicts that of the file" in str(said.value)
    assert "(here: the file; there: the vehicle)" in str(said.value)
    assert all(word in str(said.value) for word in words)


def test_variables_that_only_one_side_has_are_told():
    more = replace(CUP, variables=(*CUP.variables, Variable("heat")))
    assert any("heat is" in line and "there only" in line for line in CUP.differences(more))
    assert "unit of heat is '' here and missing there" in more.differences(CUP)


def test_words_for_people_may_differ():
    other = replace(
        CUP, success="is full", map_variables=("flow", "level"),
        actions=(Action("hold"), Action("tip")), endings=(Ending("cut"), Ending("full")),
        variables=(Variable("level", "", 0.0, 1.0, label="water"), Variable("flow")),
    )  # fmt: skip
    assert CUP.differences(other) == []
    CUP.check_same(other, "a", "b")


def test_no_field_of_a_description_is_left_out_of_the_comparison():
    """Whoever adds one decides whether two vehicles may differ in it."""
    words = {"success", "map_variables", "symmetries"}  # said for people and for learners
    compared = {
        "name", "variables", "actions", "sampling_time", "neutral", "episode_steps", "gamma",
        "endings", "action_unit", "version",
    }  # fmt: skip
    assert {field.name for field in fields(TaskDescription)} == words | compared


def test_an_ending_is_told_by_its_reward():
    task = replace(
        CUP,
        endings=(Ending("cut"), Ending("spilt", -1.0), Ending("full", 5.0), Ending("else")),
    )
    rewards = np.array([-1.0, 5.0, 0.0, -1.0, 5.0])
    ended = np.array([True, True, True, False, False])
    assert task.ending(rewards, ended).tolist() == [1, 2, 3, 0, 0]
    assert int(task.ending(5.0, True)) == 2
    assert int(task.ending(5.0, False)) == 0
    only = replace(CUP, endings=(Ending("cut"), Ending("spilt", -1.0)))
    assert only.ending(np.array([7.0]), np.array([True])).tolist() == [0]  # nobody knows better
    assert replace(CUP, endings=(Ending("cut"),)).ending(1.0, True) == 0


def test_maps_are_drawn_over_the_variables_named():
    assert CUP.map_dims == (0, 1)
    assert replace(CUP, map_variables=("flow", "level")).map_dims == (1, 0)
    assert replace(CUP, variables=CUP.variables[:1]).map_dims == (0, 0)
    assert CUP.episode_time == 500.0
    assert CUP.variables[0].axis == "level"
    assert Variable("x", "m", label="place").axis == "place [m]"
