"""The cockpit's parts: the stick, what a browser may say, the board, the door, and the maps."""

import asyncio
import json
import math

import numpy as np
import pytest
from fastapi import WebSocketDisconnect
from hypothesis import given
from hypothesis import strategies as st

from iolspi_ros.core.learner import Source, learner_class
from iolspi_ros.core.samples import Observation
from iolspi_ros.errors import InputError
from msg_bridge.cockpit import settings, words
from msg_bridge.cockpit.board import Board
from msg_bridge.cockpit.episodes import Episodes, Score
from msg_bridge.cockpit.guard import MINUTE, MOST_PAGES, Guard
from msg_bridge.cockpit.policy import POINTS, policy_map
from msg_bridge.cockpit.session import FLOOD, MOST_BROWSERS, Session
from msg_bridge.cockpit.settings import CockpitSettings, token_for
from msg_bridge.cockpit.virtual_joystick import LOST, SILENCE, Deflection, Stick
from sim_nodes.tasks.pendulum import Pendulum
from sim_nodes.tasks.slung_load import SlungLoad

LEFT = Deflection((1.0, 0.0), (0, 0, 1))
REST = Deflection((0.0, 0.0), (0, 0, 0))


# ---------------------------------------------------------------- the stick


@given(st.lists(st.tuples(st.sampled_from(["ask", "leave", "move"]), st.integers(0, 3))))
def test_one_browser_has_the_stick_and_the_others_stand_in_line(story):
    stick, line = Stick(), []
    for what, who in story:
        if what == "ask":
            stick.ask(who, 0.0)
            line += [who] if who not in line else []
        elif what == "leave":
            assert stick.leave(who, 0.0) == (line[:1] == [who])
            line = [one for one in line if one != who]
        else:
            assert stick.move(who, LEFT, 0.0) == (line[:1] == [who])
        assert [stick.holder, *stick.asking] == (line or [None])


def test_a_stick_that_changes_hands_is_at_rest():
    stick = Stick()
    stick.ask(1, 0.0)
    stick.ask(2, 0.0)
    stick.move(1, LEFT, 1.0)
    assert stick.leave(1, 2.0)
    assert (stick.holder, stick.at, stick.heard) == (2, Deflection(), 2.0)
    assert not stick.move(1, LEFT, 1.0)


def test_silence_is_noticed():
    stick = Stick()
    assert not stick.silent(1e9)
    stick.ask(1, 10.0)
    assert not stick.silent(10.0 + 0.99 * SILENCE)
    stick.move(1, LEFT, 11.0)
    assert not stick.silent(11.0 + 0.99 * SILENCE)
    assert stick.at == LEFT
    assert stick.silent(11.0 + 1.01 * SILENCE)
    assert stick.at == Deflection()
    assert not stick.lost(11.0 + 0.99 * LOST)
    assert stick.lost(11.0 + 1.01 * LOST)


# ---------------------------------------------------------------- what a browser says


def test_what_is_understood():
    move = {"say": "move", "axes": [-2.0, 0.5], "buttons": [0, 1, 0]}
    assert words.read(json.dumps(move), 3) == words.Move(Deflection((-1.0, 0.5), (0, 1, 0)))
    assert words.read('{"say": "ask"}', 3) == words.Ask()
    assert words.read('{"say": "give"}', 3) == words.Give()
    assert words.read('{"say": "call", "service": "keep"}', 3) == words.Call("keep")
    tune = '{"say": "tune", "what": "speed", "value": 0.1}'
    assert words.read(tune, 3) == words.Tune("speed", 0.1)
    tune = '{"say": "tune", "what": "corruption", "value": 0}'
    assert words.read(tune, 3) == words.Tune("corruption", 0.0)


@pytest.mark.parametrize("text", [
    "", "[", "[]", "null", "1", '"ask"', "{}", '{"say": null}', '{"say": ["ask"]}',
    '{"say": "call", "service": "shutdown"}', '{"say": "call", "service": ["keep"]}',
    '{"say": "tune", "what": "speed"}', '{"say": "tune", "what": "speed", "value": NaN}',
    '{"say": "tune", "what": "speed", "value": 0.05}', '{"say": "tune", "what": ["speed"]}',
    '{"say": "tune", "what": "speed", "value": 1e999}', '{"say": "tune", "what": {}, "value": 1}',
    '{"say": "tune", "what": "corruption", "value": true}',
    '{"say": "tune", "what": "seed", "value": 1}',
    '{"say": "move", "axes": [NaN, 0], "buttons": [0, 0, 0]}',
    '{"say": "move", "axes": [Infinity, 0], "buttons": [0, 0, 0]}',
    '{"say": "move", "axes": [null, 0], "buttons": [0, 0, 0]}',
    '{"say": "move", "axes": ["1", 0], "buttons": [0, 0, 0]}',
    '{"say": "move", "axes": [0], "buttons": [0, 0, 0]}',
    '{"say": "move", "axes": [0, 0], "buttons": [0, 0]}',
    '{"say": "move", "axes": [0, 0], "buttons": [0, 2, 0]}',
    '{"say": "move", "axes": [0, 0], "buttons": [0, [], 0]}',
    '{"say": "move", "axes": [0, 0], "buttons": 3}',
    f'{{"say": "move", "axes": [{"9" * 400}, 0], "buttons": [0, 0, 0]}}',
    "[" * 2000, '{"say": "ask", "x": "' + "x" * words.LONGEST + '"}',
])  # fmt: skip
def test_what_is_not_understood_is_refused_and_nothing_else_happens(text):
    with pytest.raises(InputError):
        words.read(text, 3)


json_values = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=5),
    lambda inner: st.lists(inner, max_size=4) | st.dictionaries(st.text(max_size=5), inner),
    max_leaves=10,
)


@given(st.sampled_from(["move", "call", "tune", "ask", "x"]), json_values, json_values, json_values)
def test_whatever_comes_is_said_or_refused(say, first, second, third):
    said = {
        "say": say,
        "axes": first,
        "buttons": second,
        "value": third,
        "service": first,
        "what": first,
    }
    try:
        read = words.read(json.dumps(said), 3)
    except InputError:
        return
    if isinstance(read, words.Move):
        assert all(-1.0 <= axis <= 1.0 for axis in read.at.axes)
        assert len(read.at.buttons) == 3
        assert set(read.at.buttons) <= {0, 1}


# ---------------------------------------------------------------- session


class Node:
    """What a session asks of a node, written down."""

    n_actions = 2

    def __init__(self):
        self.done = []

    def joy(self, at):
        self.done.append(at)

    def call(self, service):
        self.done.append(service)

    def tune(self, what, value):
        self.done.append((what, value))


class Clock:
    def __init__(self):
        self.now = 0.0

    def __call__(self):
        return self.now


@pytest.fixture
def session():
    node = Node()
    made = Session(node, Board(), Clock())
    made.node = node
    return made


def test_only_who_has_the_stick_is_listened_to(session):
    session.hear(1, words.Ask())
    session.hear(2, words.Ask())
    for said in (words.Move(LEFT), words.Call("keep"), words.Tune("speed", 0.5), words.Give()):
        with pytest.raises(InputError):
            session.hear(2, said)
    assert session.node.done == []
    for said in (words.Move(LEFT), words.Call("keep"), words.Tune("speed", 0.5), words.Move(LEFT)):
        session.hear(1, said)
    assert session.node.done == [
        LEFT,
        "keep",
        ("speed", 0.5),
    ]  # the same position again waits for its time
    session.hear(1, words.Give())
    assert session.node.done[-1] == REST
    assert session.stick.holder == 2


def test_for_a_silent_browser_neutral_comes_once_and_then_nothing_until_it_speaks(session):
    def after(seconds):
        session.node.done.clear()
        session._clock.now += seconds
        session.tick()
        return session.node.done

    session.hear(1, words.Ask())
    session.hear(1, words.Move(LEFT))
    assert after(0.5 * SILENCE) == [LEFT]
    assert after(0.4 * SILENCE) == [LEFT]
    assert after(0.2 * SILENCE) == [REST]
    assert after(0.1 * SILENCE) == []
    assert after(1.0) == []
    session.hear(1, words.Move(REST))  # it only hung for a moment
    assert session.node.done == [REST]
    assert after(0.5 * SILENCE) == [REST]
    assert after(2 * SILENCE) == [REST]
    assert after(LOST) == []
    assert session.stick.holder is None


def test_a_stick_that_was_not_moved_yet_has_all_its_buttons(session):
    session.hear(1, words.Ask())
    session.tick()
    assert session.node.done == [REST]


class Socket:
    """A browser that says some things and goes."""

    def __init__(self, texts):
        self.texts, self.sent = list(texts), []

    async def accept(self):
        pass

    async def send_text(self, text):
        self.sent.append(json.loads(text))

    async def close(self, *_):
        pass

    async def receive_text(self):
        await asyncio.sleep(0)
        if not self.texts:
            raise RuntimeError
        return self.texts.pop(0)


def test_a_browser_that_goes_lets_go_and_nonsense_is_counted(session):
    move = '{"say": "move", "axes": [1, 0], "buttons": [0, 0, 1]}'
    socket = Socket(['{"say": "ask"}', "nonsense", move.replace("1, 0", "NaN, 0"), move])
    asyncio.run(session.serve(socket))
    assert session.node.done == [LEFT, REST]
    assert session.dropped == 2
    assert session.stick.holder is None
    assert session.condition()["browsers"] == 0


def test_a_browser_that_takes_nothing_is_gone(session, monkeypatch):
    """As in a machine that is suspended: its connection is open for as long as nobody ends it."""
    monkeypatch.setattr("msg_bridge.cockpit.session.STALLED", 0.01)
    session.hear(1, words.Ask())
    session.hear(1, words.Move(LEFT))

    class Suspended(Socket):
        async def receive_text(self):
            await asyncio.sleep(60.0)

        async def send_text(self, text):
            await asyncio.sleep(60.0 if self.sent else 0.0)
            self.sent.append(text)

    asyncio.run(asyncio.wait_for(session.serve(Suspended([])), 10.0))
    assert session.condition()["browsers"] == 0
    assert session.stick.holder is None
    assert session.node.done == [LEFT, REST]


@pytest.mark.parametrize("error", [WebSocketDisconnect(), RuntimeError(), KeyError("text")])
def test_however_a_browser_goes_nobody_complains(session, error):
    """In the middle of a word to it, too: a flood's end left a page of errors in the log."""

    class Gone(Socket):
        async def receive_text(self):
            raise error

        async def close(self, *_):
            raise WebSocketDisconnect

    asyncio.run(session.serve(Gone([])))
    assert session.condition()["browsers"] == 0


def test_a_browser_that_is_gone_at_once_takes_nobody_s_place(session):
    class Gone(Socket):
        async def send_text(self, text):
            raise WebSocketDisconnect

    for _ in range(2 * MOST_BROWSERS):
        asyncio.run(session.serve(Gone([])))
    assert session.condition()["browsers"] == 0


def test_what_nobody_expects_is_not_kept_quiet(session):
    class Broken(Socket):
        async def receive_text(self):
            raise ZeroDivisionError

    with pytest.raises(ZeroDivisionError):
        asyncio.run(session.serve(Broken([])))
    assert session.condition()["browsers"] == 0


def test_a_flood_is_dropped_and_shut_out(session):
    move = '{{"say": "move", "axes": [{}, 0], "buttons": [0, 0, 0]}}'
    flood = [move.format((-1) ** n) for n in range(2 * FLOOD)]
    socket = Socket(['{"say": "ask"}', *flood])
    asyncio.run(session.serve(socket))
    assert len(session.node.done) < 300
    assert len(socket.texts) >= FLOOD - 1  # never read


# ---------------------------------------------------------------- board, door, settings


def test_a_browser_is_sent_only_what_is_new_and_the_newest_of_it():
    board = Board()
    board.put("a", 1)
    board.put("b", {"x": [math.nan, 1.5, -math.inf]})
    board.put("a", 2)
    version, parts = board.since(0)
    assert [json.loads(part) for part in parts] == [
        {"part": "b", "is": {"x": [None, 1.5, None]}}, {"part": "a", "is": 2},
    ]  # fmt: skip
    assert board.since(version) == (version, [])
    board.put("b", 3)
    assert [json.loads(part)["is"] for part in board.since(version)[1]] == [3]


def ask(guard, headers=(), query=b"", kind="http", path="/"):
    """Status of an answer, or 200 when the request came through."""
    sent = []

    async def send(message):
        sent.append(message)

    scope = {"type": kind, "headers": list(headers), "query_string": query, "path": path}
    asyncio.run(guard(scope, None, send))
    first = sent[0]
    return first.get("status", first.get("code")), dict(first.get("headers", []))


async def inside(scope, receive, send):
    await send({"type": "http.response.start", "status": 200, "headers": []})


HERE = (b"host", b"127.0.0.1:8000")


@pytest.mark.parametrize("kind", ["http", "websocket"])
def test_the_token_opens_the_door_and_nothing_else_does(kind):
    token = "0123456789abcdef"
    guard = Guard(inside, token, "0.0.0.0")
    refused = 403 if kind == "http" else 1008
    cookie = f"a=b; iolspi_cockpit={token}".encode()
    for headers, query, wanted in (
        ((HERE,), b"", refused),
        ((HERE,), b"token=0123456789abcde", refused),
        ((HERE,), b"token=", refused),
        ((HERE,), b"token=%FF%C3%A9", refused),
        ((HERE, (b"cookie", b"iolspi_cockpit=x")), b"", refused),
        ((HERE, (b"cookie", b'\xff="')), b"", refused),
        ((HERE,), f"token={token}".encode(), 200),
        ((HERE, (b"cookie", cookie)), b"", 200),
    ):
        assert ask(guard, headers, query, kind)[0] == wanted, (headers, query)


def test_the_cookie_is_for_this_page_alone():
    _, headers = ask(
        Guard(inside, "0123456789abcdef", "0.0.0.0"), (HERE,), b"token=0123456789abcdef"
    )
    assert b"HttpOnly" in headers[b"set-cookie"]
    assert b"SameSite=Strict" in headers[b"set-cookie"]


def test_pages_without_end_are_refused_and_files_are_not():
    clock = Clock()
    guard = Guard(inside, "", "127.0.0.1", clock)

    def load(path):
        return ask(guard, (HERE,), path=path)[0]

    for n in range(MOST_PAGES):
        assert load("/" if n % 2 else f"/{n}") == 200
        clock.now += 0.1
    assert load("/") == load("/nobody") == 503
    assert load("/cockpit/cockpit.js") == load("/_nicegui/3.18.0/static/nicegui.js") == 200
    assert ask(guard, (HERE,), kind="websocket")[0] == 200
    clock.now = MINUTE
    assert load("/") == 200
    assert load("/") == 503
    clock.now += MINUTE
    assert [load("/") for _ in range(MOST_PAGES + 1)] == [200] * MOST_PAGES + [503]


@pytest.mark.parametrize(("host", "wanted"), [
    (b"127.0.0.1:8000", 200), (b"localhost:8000", 200), (b"[::1]:8000", 200),
    (b"evil.example:8000", 403), (b"", 403), (b"[", 403),
])  # fmt: skip
def test_a_name_of_somebody_else_for_this_machine_is_refused(host, wanted):
    """A page elsewhere whose name suddenly leads here could fly otherwise."""
    assert ask(Guard(inside, "", "127.0.0.1"), ((b"host", host),))[0] == wanted


def test_a_page_of_somebody_else_cannot_open_a_socket():
    guard = Guard(inside, "", "127.0.0.1")
    origin = (b"origin", b"http://evil.example")
    assert ask(guard, (HERE, origin), kind="websocket")[0] == 1008
    assert ask(guard, (HERE, (b"origin", b"http://" + HERE[1])), kind="websocket")[0] == 200


def test_elsewhere_only_with_a_token(monkeypatch):
    monkeypatch.delenv(settings.TOKEN, raising=False)
    assert token_for(CockpitSettings()) == ""
    with pytest.raises(InputError, match=r"host is '0\.0\.0\.0'.*IOLSPI_COCKPIT_TOKEN is missing"):
        token_for(CockpitSettings(host="0.0.0.0"))
    for bad in ("short", "0123456789abcde\n", "0123456789 abcdef", "é" * 20):
        monkeypatch.setenv(settings.TOKEN, bad)
        with pytest.raises(InputError, match="is no token; allowed: at least 16 characters"):
            token_for(CockpitSettings())
    monkeypatch.setenv(settings.TOKEN, "0123456789abcdef")
    assert token_for(CockpitSettings(host="0.0.0.0")) == "0123456789abcdef"


# ---------------------------------------------------------------- what is shown


def episode(number, rewards, source, angle=0.0):
    for step, reward in enumerate([0.0, *rewards]):
        yield Observation(
            number, step, np.array([angle, 1.0]), reward, 0 if step else -1, False,
            step == len(rewards), source=source if step else -1,
        )  # fmt: skip


def test_scores_are_sums_of_episodes_that_were_seen_whole():
    shown = Episodes(Pendulum().description)
    for seen in episode(3, [-1.0, -2.0, -4.0], Source.HUMAN):
        shown.take(seen)
        shown.take(seen)  # repeated
    for seen in list(episode(4, [-1.0] * 5, Source.EXPLOIT))[2:]:
        shown.take(seen)
    for seen in episode(5, [-1.0] * 5, Source.HOLD):  # nobody flew
        shown.take(seen)
    assert list(shown.scores.values()) == [Score(3, -7.0, True)]
    shown.score(Score(4, -5.0, False, 2))
    assert shown.scores[4] == Score(4, -5.0, False, 2)


@pytest.mark.parametrize("before", [0, 2, 3, 4])
def test_what_the_learner_says_of_an_episode_counts_whenever_it_comes(before):
    """Its word may come before the states that are shown, which are looked at 30 times a second."""
    shown = Episodes(Pendulum().description)
    states = list(episode(3, [-1.0, -2.0, -4.0], Source.HUMAN))
    for seen in states[:before]:
        shown.take(seen)
    shown.score(Score(3, -6.9, False, 2))
    for seen in states[before:]:
        shown.take(seen)
    assert shown.scores == {3: Score(3, -6.9, True, 2)}


def test_visits_are_counted_where_they_were():
    shown = Episodes(Pendulum().description)
    for seen in episode(0, [0.0] * 9, Source.EXPLOIT, angle=3.1):
        shown.take(seen)
    assert shown.as_shown(-1)["who"] == "learner"
    visits = shown.map_of_visits()
    assert visits.sum() == 10
    row, column = np.argwhere(visits)[0]
    n = len(visits)
    assert column == n - 1  # an angle near pi: the right edge
    assert row == n // 2  # a small rate upwards of zero
    assert shown.map_of_visits().sum() == 10


def test_the_map_shows_what_the_learner_would_do():
    task = Pendulum().description
    kind = learner_class("iolspi")
    learner = kind(task, kind.Settings(centers=(5, 5)), np.random.default_rng(1))
    limits = ((-3.0, 3.0), (-40.0, 40.0))
    shown = policy_map(learner, learner.snapshot, limits)
    for i, j in ((0, 0), (POINTS - 1, 0), (7, 30)):
        state = np.array([-3.0 + 6.0 * i / (POINTS - 1), -40.0 + 80.0 * j / (POINTS - 1)])
        action, _ = learner.act(state, explore=False)
        assert shown["action"][j * POINTS + i] == action
        value = learner.values(state[None])[0].max()
        share = (value - shown["low"]) / (shown["high"] - shown["low"])
        assert shown["value"][j * POINTS + i] == pytest.approx(share, abs=1e-3)


def test_how_an_episode_ended_is_said_in_the_task_s_words():
    task = SlungLoad().description
    dunk = next(ending for ending in task.endings if ending.success and ending.reward is not None)
    shown = Episodes(task)
    shown.take(Observation(0, 0, np.zeros(4)))
    shown.take(Observation(0, 1, np.zeros(4), dunk.reward, 3, True, False))
    assert shown.as_shown(-1)["ended"] == dunk.name
    shown.take(Observation(1, 0, np.zeros(4)))
    assert shown.as_shown(-1)["ended"] == dunk.name  # until another one ends
    assert shown.as_shown(-1)["who"] == "nobody yet"
    shown.take(Observation(1, 1, np.zeros(4), 0.0, 1, False, True))
    assert shown.as_shown(-1)["ended"] == ""
