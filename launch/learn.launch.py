"""Vehicles and who learns from them, from config/TASK.yaml.

ros2 launch iolspi_ros learn.launch.py task:=slung_load demonstration:=2 mode:=realtime
ros2 launch iolspi_ros learn.launch.py namespace:=v1 joystick:=true record:=my_set
ros2 launch iolspi_ros learn.launch.py cockpit:=true mode:=realtime
ros2 launch iolspi_ros learn.launch.py vehicles:=3 learners:=one
"""

from pathlib import Path

from ament_index_python.packages import get_package_share_directory
from launch.actions import DeclareLaunchArgument, OpaqueFunction
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node

from iolspi_ros import resources
from iolspi_ros.cli.cockpit import from_page
from launch import LaunchDescription
from sim_nodes.tasks import task_class

ARGUMENTS = {
    "task": ("pendulum", "a registered task, or module:Class"),
    "mode": ("lockstep", "lockstep or realtime"),
    "demonstration": ("5", "shipped set, 1 to 5; 0 for none"),
    "joystick": ("false", "demonstrate by joystick (topic joy) instead of a shipped set"),
    "cockpit": ("false", "fly in the browser, whose page is the joystick; see docs/cockpit.md"),
    "record": ("", "bag to record a demonstration by joystick to"),
    "seed": ("0", "of simulator and learner"),
    "checkpoint": ("", "file to save to"),
    "namespace": ("", "of all nodes"),
    "vehicles": ("1", "how many; with more than one they are in NAMESPACE/v1, NAMESPACE/v2, …"),
    "learners": ("each", "each vehicle has a learner of its own, or one learns from all"),
}


def nodes(context):
    chosen = {name: LaunchConfiguration(name).perform(context) for name in ARGUMENTS}
    n, space = int(chosen["vehicles"]), chosen["namespace"].strip("/")
    if n < 1 or chosen["learners"] not in ("each", "one"):
        raise ValueError(
            f"vehicles:={n} learners:={chosen['learners']}; allowed: 1 and more; each, one"
        )
    if n == 1:
        return vehicle(chosen, chosen["namespace"], int(chosen["seed"]))
    spaces = [f"/{space}/v{k + 1}".replace("//", "/") for k in range(n)]
    others = spaces[1:] if chosen["learners"] == "one" else []
    found = []
    for k, place in enumerate(spaces):
        own = chosen | {name: apart(chosen[name], f"v{k + 1}") for name in ("checkpoint", "record")}
        found += vehicle(own, place, int(chosen["seed"]) + k, others, learns=place not in others)
    return found


def apart(path, name):
    """A file or folder of its own for each vehicle."""
    return str(Path(path).with_stem(f"{Path(path).stem}_{name}")) if path else ""


def vehicle(chosen, namespace, seed, others=(), learns=True):
    """The nodes of one namespace; its learner flies the others, too."""
    task, realtime = chosen["task"], chosen["mode"] == "realtime"
    file = resources.config(task)
    shared = [str(file)] if file else []
    bag = f"{get_package_share_directory('iolspi_ros')}/demos/{task}/set_{chosen['demonstration']}"
    in_browser = chosen["cockpit"] == "true"
    by_hand = in_browser or chosen["joystick"] == "true"
    shown = by_hand or chosen["demonstration"] != "0"
    if by_hand:
        demonstration = {"source": "joy", "record": chosen["record"]}
        if in_browser:
            demonstration |= from_page(task_class(task)().description.n_actions)
    else:
        demonstration = {"source": "bag", "bags": [bag]}
    learner = {"seed": seed, "checkpoint": chosen["checkpoint"], "background": realtime}
    learner |= {"other_vehicles": list(others)} if others else {}
    parameters = {"simulator": {"task": task, "mode": chosen["mode"], "seed": seed}}
    if learns:
        parameters["learner"] = learner | {"wait_for_demonstrations": shown}
    if learns and shown:
        parameters["demonstrator"] = demonstration
    if in_browser:
        parameters["cockpit"] = {}
    return [
        Node(
            package="iolspi_ros",
            executable=name,
            namespace=namespace,
            parameters=[*shared, values] if values else [],
            output="screen",
        )
        for name, values in parameters.items()
    ]


def generate_launch_description() -> LaunchDescription:
    declared = [
        DeclareLaunchArgument(name, default_value=default, description=text)
        for name, (default, text) in ARGUMENTS.items()
    ]
    return LaunchDescription([*declared, OpaqueFunction(function=nodes)])
