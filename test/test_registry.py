"""Learners and tasks of others, by entry point or as module:Class."""

import pytest

from iolspi_ros import registry
from iolspi_ros.core.learner import learner_class
from iolspi_ros.core.online import OnlineLSPI
from iolspi_ros.errors import InputError
from sim_nodes.tasks import names, task_class
from sim_nodes.tasks.pendulum import Pendulum


def test_what_is_registered_is_found_by_name():
    assert set(names()) >= {"cart_pole", "pendulum", "slung_load"}
    assert list(names()) == sorted(names())
    assert task_class("pendulum") is Pendulum
    assert learner_class("iolspi") is OnlineLSPI


def test_what_is_not_registered_is_found_by_module_and_class(tmp_path, monkeypatch):
    (tmp_path / "of_somebody.py").write_text(
        "from sim_nodes.tasks.pendulum import Pendulum\n"
        "class Heavy(Pendulum):\n"
        "    pass\n"
        "class Nothing:\n"
        "    pass\n"
        "class Bare:\n"
        "    step = initial_states = draw_initial = None\n"
    )
    monkeypatch.syspath_prepend(tmp_path)
    assert issubclass(task_class("of_somebody:Heavy"), Pendulum)
    lacking = "task of_somebody:Nothing has no step, initial_states, draw_initial; allowed: a class"
    with pytest.raises(InputError, match=lacking):
        task_class("of_somebody:Nothing")
    with pytest.raises(InputError, match="task of_somebody:Bare has no description; allowed"):
        task_class("of_somebody:Bare")
    with pytest.raises(InputError, match="learner of_somebody:Nothing has no Settings, State, ch"):
        learner_class("of_somebody:Nothing")


@pytest.mark.parametrize(
    ("name", "words"),
    [
        (
            "kite",
            "task is 'kite'; allowed: .*pendulum.*, or module:Class .entry-point group iolspi",
        ),
        ("", "task is ''; allowed: .*pendulum"),
        ("no.such.module:Kite", "task 'no.such.module:Kite' cannot be imported: No module named"),
        ("sim_nodes.tasks.pendulum:Kite", "cannot be imported: .*has no attribute 'Kite'; allowed"),
        (":Kite", "task ':Kite' cannot be imported: .*; allowed: .*pendulum"),
        ("math:", "task 'math:' cannot be imported"),
    ],
)
def test_what_is_not_there_is_told_with_what_there_is(name, words):
    with pytest.raises(InputError, match=words):
        task_class(name)


def test_an_error_in_somebody_s_module_is_told_as_it_is(tmp_path, monkeypatch):
    (tmp_path / "broken_by_somebody.py").write_text("import no_such_module_at_all\n")
    monkeypatch.syspath_prepend(tmp_path)
    with pytest.raises(InputError, match="cannot be imported: No module named 'no_such_module_at"):
        learner_class("broken_by_somebody:Learner")


def test_the_same_class_comes_from_both_ways():
    by_path = registry.find("iolspi_ros.tasks", "task", "sim_nodes.tasks.pendulum:Pendulum")
    assert by_path is task_class("pendulum")
