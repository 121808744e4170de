"""What `iolspi fly` is to fly: checked before anything happens, and put into words by `--plan`."""

from __future__ import annotations

import socket
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import yaml

from iolspi_ros import resources
from iolspi_ros.cli.progress import bar
from iolspi_ros.errors import InputError, check_choice, check_range
from iolspi_ros.settings import from_mapping

if TYPE_CHECKING:
    from msg_bridge.mavlink.profiles import AutopilotProfile
    from msg_bridge.mavlink.settings import FlightSettings, LinkSettings

TASKS = ("slung_load", "slung_load_3d")
"""Those that `msg_bridge.mavlink.flown` flies."""
EMBEDDED = "embedded"
URLS = {"px4": "udpin:127.0.0.1:14540", "ardupilot": "tcp:127.0.0.1:5760", "paparazzi": ""}
AUTOPILOTS = (EMBEDDED, *URLS)
MODELS = ("autopilot", "ideal")
"""What may be practised on: a model that answers as the autopilot does, or T's own."""
_SLUGGISH = ("delay", "lag", "drag")
_MOST = 4 / 3  # of the autopilot's: practice goes from nothing to so much, and what is typical
_GAIN_SPREAD = 0.1
_GOOD, _LONGEST, _ROUND = 0.98, 2, 50  # successes; times the practice; episodes at once
_SHARED = ("basket", "basket_radius", "cable", "accelerations")  # of model and flight, if it has it
_SLACK = 0.05  # of wall time that an answer may be late by, whatever the speed-up [s]


class FlightPlan(NamedTuple):
    """What is to be flown.

    Attributes
    ----------
    task : str
        One of `TASKS`.
    url : str
    autopilot : str
        Who must be there: px4 or ardupilot.
    embedded : bool
        It is started here.
    speed_up : float
        Vehicle seconds per second.
    bag, checkpoint : Path or None
        What is learned from first, or what was.
    practice, episodes, shown : int
        Episodes on the model, in the air while learning, in the air without.
    practise_on : str
        One of `MODELS`.
    seed : int
    pretrained_on : str
        In words.
    bridge : dict
        More parameters of the bridge.
    demonstrated : int
        Samples that taught it, as far as they were not sent over the graph.
    """

    task: str
    url: str
    autopilot: str
    embedded: bool
    speed_up: float
    bag: Path | None
    checkpoint: Path | None
    practice: int
    practise_on: str
    episodes: int
    shown: int
    seed: int
    pretrained_on: str
    bridge: dict[str, Any]
    demonstrated: int = 0

    @property
    def vehicle(self) -> str:
        """In words."""
        return f"embedded, like {self.autopilot}" if self.embedded else self.autopilot

    @property
    def config(self) -> Path:
        """The parameter file of all nodes."""
        return resources.find("config", f"{self.task}.yaml")

    def parameters(self) -> dict[str, Any]:
        """Of the bridge, beside those of the file."""
        return {
            "url": self.url, "autopilot": self.autopilot, "seed": self.seed,
            "real_time_factor": float(self.speed_up),
            "action_timeout": 0.1 + _SLACK * max(self.speed_up, 1.0),
        } | self.bridge  # fmt: skip

    def settings(self) -> tuple[LinkSettings, FlightSettings]:
        """Those of link and flight, as the bridge will have them."""
        from msg_bridge.mavlink.settings import FlightSettings, LinkSettings

        return self._of(LinkSettings), self._of(FlightSettings)

    @property
    def answers(self) -> dict[str, float]:
        """Settings by which the model that is practised on answers as the autopilot may.

        From episode to episode it is anything between an ideal vehicle and one that is a third
        more sluggish than was measured. Empty for the ideal one.
        """
        from msg_bridge.mavlink.flown import TASKS
        from msg_bridge.mavlink.profiles import IDEAL, PROFILES

        answer = PROFILES[self.autopilot].answer
        able = hasattr(TASKS[self.task], "as_flown")
        if self.practise_on == "ideal" or answer == IDEAL or not able:
            return {}
        found = {name: getattr(answer, name) * _MOST / 2.0 for name in _SLUGGISH}
        found |= {f"{name}_spread": 1.0 for name in _SLUGGISH}
        return found | {
            "gain": answer.gain, "gain_spread": _GAIN_SPREAD, "push_spread": answer.push
        }  # fmt: skip

    def model(self) -> Any:
        """The vehicle that is practised on."""
        from sim_nodes.tasks import make_task

        values = resources.parameters(self.config, "simulator") | self.answers
        return make_task(self.task, values, str(self.config))

    def check(self) -> None:
        """Raise unless the bridge would fly it.

        Raises
        ------
        InputError
            Naming the parameter, its value and what is allowed.
        """
        from msg_bridge.mavlink.envelope import Limits, widened
        from msg_bridge.mavlink.flown import TASKS, check_room, flown
        from msg_bridge.mavlink.profiles import PROFILES

        _, flight = self.settings()
        profile = PROFILES[self.autopilot]
        limits = widened(self._of(Limits), profile.noise, profile.speed_noise)
        task = self._of(TASKS[self.task])
        check_room(flown(task, flight), flight, limits)
        model = from_mapping(
            TASKS[self.task], resources.parameters(self.config, "simulator"), str(self.config)
        )
        for name in _SHARED:
            there, here = getattr(model, name, None), getattr(task, name, None)
            if there != here:
                raise InputError(
                    f"{name} of the bridge is {here}, of the model that is practised on {there}; "
                    f"allowed: the same, in {self.config.name}"
                )

    def _of(self, kind: type[Any]) -> Any:
        values = resources.parameters(self.config, "bridge") | self.parameters()
        return from_mapping(kind, values, "--bridge")


def make_plan(
    task: str, autopilot: str, url: str | None, like: str, speed_up: float, load: str,
    demonstration: int, checkpoint: Path | None, practice: int, practise_on: str, episodes: int,
    shown: int, seed: int, bridge: list[str],
) -> FlightPlan:  # fmt: skip
    """The plan that the options of `iolspi fly` make.

    Raises
    ------
    InputError
        When it cannot be flown so.
    """
    from iolspi_ros.experiments.samplesets import mode_and_corruption
    from msg_bridge.mavlink import urls
    from msg_bridge.mavlink.profiles import PROFILES
    from sim_nodes.autopilot.firmware import FIRMWARES

    check_choice("--task", task, TASKS)
    check_choice("--autopilot", autopilot, AUTOPILOTS)
    check_choice("--like", like, tuple(FIRMWARES))
    check_choice("--load", load, ("feed", "estimate"))
    check_choice("--practise-on", practise_on, MODELS)
    check_range("--speed-up", speed_up, 0.1, 20.0)
    check_range("--episodes", episodes, 0, 1e6)
    check_range("--shown", shown, 1, 1e6)
    if autopilot in PROFILES and PROFILES[autopilot].flies_not:
        raise InputError(
            f"--autopilot {autopilot} cannot be flown over MAVLink: {PROFILES[autopilot].flies_not}"
        )
    mode_and_corruption(demonstration)
    embedded = autopilot == EMBEDDED
    place = url or (f"udpin:127.0.0.1:{free_port()}" if embedded else URLS[autopilot])
    address = urls.parse(place)
    if embedded and address.kind not in ("udpin", "udpout"):
        raise InputError(f"--url {url}: allowed for the embedded autopilot: udpin, udpout")
    bag = None if checkpoint else resources.find("demos", task, f"set_{demonstration}")
    if checkpoint and not checkpoint.is_file():
        raise InputError(f"--checkpoint {checkpoint} is not there; allowed: a file")
    plan = FlightPlan(
        task, str(address), like if embedded else autopilot, embedded, speed_up, bag, checkpoint,
        practice if bag else 0, practise_on, episodes, shown, seed,
        f"demonstration set {demonstration}" if bag else f"what {checkpoint} holds",
        {"load_source": load} | assignments(bridge),
    )  # fmt: skip
    plan.check()
    return plan


def assignments(texts: Iterable[str]) -> dict[str, Any]:
    """What NAME=VALUE says, of each.

    Raises
    ------
    InputError
        When one is none.
    """
    return dict(_assignment(text) for text in texts)


def _assignment(text: str) -> tuple[str, Any]:
    name, found, value = text.partition("=")
    if not found or not name:
        raise InputError(f"--bridge is {text!r}; allowed: NAME=VALUE of a parameter of the bridge")
    return name, yaml.safe_load(value)


def free_port() -> int:
    """A UDP port of this machine that nobody has."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


def practise(plan: FlightPlan, out: Path) -> FlightPlan:
    """Learn from the demonstrations, then online on the model; what is learned is flown.

    On a model that answers as the autopilot may, a policy is better after some updates than after
    others: there practice goes on until it is good, and the best one is flown.
    """
    from iolspi_ros.bags import read_demonstration
    from iolspi_ros.core.learner import greedy_policy
    from iolspi_ros.experiments.evaluate import evaluate
    from iolspi_ros.experiments.headless import Listener, prepare, train
    from iolspi_ros.saving import checkpoint
    from sim_nodes.world import make_world

    assert plan.bag is not None
    ideal, learner, name = prepare(plan.task, plan.config, plan.seed)
    model = plan.model()
    world = make_world(model, ideal.settings, ideal.rng)
    samples = read_demonstration(plan.bag, learner.task).transitions()
    learner.pretrain(samples)
    path, done = out / "practised.npz", 0

    def train_for(what: str, episodes: int) -> None:
        begun = done
        with bar(what, episodes) as show:

            def ended(score: float, reward: float, terminated: bool) -> None:
                nonlocal done
                done += 1
                show(done - begun)

            train(world, learner, episodes, Listener(on_episode=ended))

    train_for("practising on the model [episodes]", plan.practice)
    checkpoint.save(path, learner, name)
    words = f"{plan.practice} episodes on {_model(plan)}"
    if plan.answers:
        best = share = evaluate(model, greedy_policy(learner)).success_fraction
        while share < _GOOD and done < _LONGEST * plan.practice:
            train_for(f"{share:.0%} succeed; practising on [episodes]", _ROUND)
            share = evaluate(model, greedy_policy(learner)).success_fraction
            if share > best:
                best = share
                checkpoint.save(path, learner, name)
        words = f"{done} episodes on {_model(plan)} (the best policy there: {best:.0%})"
    return plan._replace(
        bag=None, checkpoint=path, demonstrated=len(samples),
        pretrained_on=f"{plan.pretrained_on} and {words}",
    )  # fmt: skip


# ------------------------------------------------------------ in words


def _model(plan: FlightPlan) -> str:
    """What is practised on."""
    a = plan.answers
    if not a:
        return "the model"
    delay, lag, drag = (2.0 * a[name] for name in _SLUGGISH)
    low, high = (a["gain"] * (1.0 + side * a["gain_spread"]) for side in (-1.0, 1.0))
    return (
        f"a model that answers as {plan.autopilot} may: up to {delay:.2f} s late, with a lag up to "
        f"{lag:.2f} s, drag up to {drag:.1f} /s, {low:.2f} to {high:.2f} times what is asked for, "
        f"pushed by up to {a['push_spread']:g} m/s²"
    )


def describe(plan: FlightPlan) -> Iterator[str]:
    """What a flight would set and send, a line for each."""
    from msg_bridge.mavlink.memory import Memory
    from msg_bridge.mavlink.profiles import PROFILES

    profile, (link, flight) = PROFILES[plan.autopilot], plan.settings()
    if plan.practice:
        yield f"Learn from {plan.pretrained_on}, then {plan.practice} episodes on {_model(plan)}."
        if plan.answers:
            yield (
                f"  Up to {_LONGEST} times as many, until {_GOOD:.0%} succeed there; the best "
                "policy is flown."
            )
    else:
        yield f"Learn from {plan.pretrained_on}."
    yield (
        f"Look who is at {plan.url}: {profile.name}, system {link.system}, or nothing flies. Until "
        "then HEARTBEAT and TIMESYNC are sent, as system 255."
    )
    yield f"Set, remembered in {Memory().folder} and given back after every end:"
    for change in profile.changes:
        yield f"  {' or '.join(change.names)} = {change.value:g}: {change.why}"
    yield f"Ask for {_rates(profile, flight.load_share > 0.0)}."
    yield from _describe_release(profile, flight)
    how = "stream setpoints, then take the mode" if profile.stream_first else "take the mode"
    climb = "by setpoints" if profile.stream_first else "by MAV_CMD_NAV_TAKEOFF"
    yield (
        f"When the bridge is activated: {how} {profile.mode_name(profile.controlled)}, arm (never "
        f"by force), climb to {flight.height:g} m {climb}."
    )
    yield (
        f"Fly {plan.episodes} episodes of {plan.task} while learning and {plan.shown} without: "
        f"SET_POSITION_TARGET_LOCAL_NED, type mask 0x{profile.acceleration:04X}, {flight.rate:g} "
        "times a second of vehicle time; each episode a release, and a new load."
    )
    yield f"Land in {profile.mode_name(profile.landing)}, and give the parameters back."


def _rates(profile: AutopilotProfile, felt: bool) -> str:
    from pymavlink.dialects.v20.ardupilotmega import mavlink_map

    from msg_bridge.mavlink.link import rates

    found = rates(profile, felt=felt).items()
    return ", ".join(f"{mavlink_map[number].msgname} at {rate:g} Hz" for number, rate in found)


def _describe_release(profile: AutopilotProfile, flight: FlightSettings) -> Iterator[str]:
    how = profile.release if flight.release == "auto" else flight.release
    setup = profile.gripper
    if how == "gripper":
        needs = [f"{name} {good[0]:g}" for name, good in setup.needs]
        output = f"{setup.usual} {setup.function:g} (or another output)"
        needs += [output] if setup.moves_disarmed else []
        yield f"Check that it has booted with {', '.join(needs)}: nothing would fall otherwise."
        if not setup.moves_disarmed:
            yield f"  With {output} besides, its output is watched in flight; else it is unproven."
    if flight.test_release:
        yield (
            f"Open and shut the {how} once, disarmed on the ground: hands off; hang the load again."
        )
    feed = flight.load_source == "feed"
    load = "reported by a system of its own" if feed else "estimated, and seen by nobody"
    yield f"The load's swing: {load} (load_source: {flight.load_source})."
