"""Parameter files reach the node they are for, whatever it is called, or say that they do not."""

import pytest
import yaml
from hypothesis import given
from hypothesis import strategies as st

from iolspi_ros import arguments
from iolspi_ros.errors import InputError
from iolspi_ros.task import plain


def file(folder, sections, name="p.yaml"):
    path = folder / name
    path.write_text(
        yaml.safe_dump({key: {"ros__parameters": values} for key, values in sections.items()})
    )
    return str(path)


def given_to(folder, sections, *more, kind="learner"):
    given = ["python", "--ros-args", "--params-file", file(folder, sections), *more]
    with arguments.for_node(given, kind) as adapted:
        return arguments.given(adapted, kind)


ROOT, NAMESPACE = (), ("-r", "__ns:=/v1")
RENAMED = ("-r", "__node:=pupil")
BOTH = ("-r", "__ns:=/a/b", "-r", "learner:__node:=pupil")


@pytest.mark.parametrize("more", [ROOT, NAMESPACE, RENAMED, BOTH])
@pytest.mark.parametrize("section", ["/**", "/**/learner", "learner", "/learner"])
def test_a_section_for_the_kind_is_for_every_node_of_it(tmp_path, section, more):
    assert given_to(tmp_path, {section: {"seed": 4}}, *more) == {"seed": 4}


@pytest.mark.parametrize(
    ("section", "more"),
    [("/v1/learner", NAMESPACE), ("/*/learner", NAMESPACE), ("/pupil", RENAMED),
     ("/a/**/pupil", BOTH), ("/a/b/pupil", BOTH), ("/**/pupil", BOTH)],
)  # fmt: skip
def test_patterns_match_as_those_of_ros_do(tmp_path, section, more):
    assert given_to(tmp_path, {section: {"seed": 4}}, *more) == {"seed": 4}


@pytest.mark.parametrize(
    ("section", "more", "name"),
    [("simulator", ROOT, "/learner"), ("/v2/learner", NAMESPACE, "/v1/learner"),
     ("/**/simulator", BOTH, "/a/b/pupil"), ("/*/pupil", RENAMED, "/pupil"),
     ("/a/pupil", BOTH, "/a/b/pupil")],
)  # fmt: skip
def test_a_file_that_says_nothing_to_the_node_is_an_error_with_both_names(
    tmp_path, section, more, name
):
    with pytest.raises(InputError) as said:
        given_to(tmp_path, {section: {"seed": 4}}, *more)
    text = str(said.value)
    assert f"says nothing to {name}:" in text
    assert f"it is for /{section.strip('/')};" in text
    assert "p.yaml" in text
    assert f"allowed: a section /**/learner, /** or {name}" in text


def test_an_empty_file_is_for_nobody(tmp_path):
    with pytest.raises(InputError, match="it is for nobody"):
        given_to(tmp_path, {})


def test_the_last_one_given_counts(tmp_path):
    first = file(tmp_path, {"learner": {"seed": 1, "epsilon": 0.1}}, "a.yaml")
    second = file(tmp_path, {"/**": {"seed": 2}}, "b.yaml")
    given = ["x", "--ros-args", "--params-file", first, "-p", "epsilon:=0.3", "--params-file",
             second, "-p", "learner:chi:=0.5", "-p", "simulator:seed:=9"]  # fmt: skip
    assert arguments.given(given, "learner") == {"seed": 2, "epsilon": 0.3, "chi": 0.5}


def test_only_what_stands_among_the_ros_arguments_counts(tmp_path):
    path = file(tmp_path, {"learner": {"seed": 1}})
    given = ["x", "--params-file", path, "--ros-args", "-p", "seed:=2", "--", "-p", "seed:=3"]
    assert arguments.given(given, "learner") == {"seed": 2}
    assert arguments.without_files(given) == given
    ros = ["x", "--ros-args", "--params-file", path, "-p", "seed:=2"]
    assert arguments.without_files(ros) == ["x", "--ros-args", "-p", "seed:=2"]


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("]: [", "is no YAML"),
        ("just words", "is no ROS parameter file; allowed: NODE: ros__parameters: NAME: value"),
        ("[1, 2]", "is no ROS parameter file"),
        ("learner: 5", "is no ROS parameter file"),
        ("learner: {ros__parameters: 5}", "is no ROS parameter file"),
        ("#" * (plain.LARGEST_YAML + 1), r"has \d+ characters; allowed: at most"),
    ],
)
def test_a_file_that_is_none_is_named(tmp_path, text, words):
    path = tmp_path / "junk.yaml"
    path.write_text(text)
    with pytest.raises(InputError, match=f"junk.yaml {words}"):
        arguments.read_sections(path)


def test_nested_namespaces_and_parameters_are_found(tmp_path):
    path = tmp_path / "deep.yaml"
    path.write_text("a:\n  b:\n    learner:\n      ros__parameters:\n        x: {y: 1}\n")
    assert arguments.read_sections(path) == {"/a/b/learner": {"x": {"y": 1}}}
    given = ["x", "--ros-args", "-r", "__ns:=/a/b", "--params-file", str(path)]
    assert arguments.given(given, "learner") == {"x.y": 1}


parts = st.lists(st.from_regex(r"[a-z]{1,3}", fullmatch=True), min_size=1, max_size=4)


@given(parts)
def test_a_name_matches_itself_and_what_has_stars_in_place_of_parts(name):
    text = "/" + "/".join(name)
    assert arguments.matches(text, text)
    assert arguments.matches("/**", text)
    assert arguments.matches(f"/**/{name[-1]}", text)
    assert arguments.matches("/*" * len(name), text)
    assert not arguments.matches("/*" * (len(name) + 1), text)
    assert not arguments.matches(f"{text}x", text)
