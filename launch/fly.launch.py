"""The bridge to an autopilot and who learns from it, from config/TASK.yaml: docs/sitl.md.

ros2 launch iolspi_ros fly.launch.py autopilot:=px4 load:=estimate
ros2 launch iolspi_ros fly.launch.py url:=tcp:127.0.0.1:5760 autopilot:=ardupilot load:=estimate
"""

from ament_index_python.packages import get_package_share_directory
from launch.actions import DeclareLaunchArgument, OpaqueFunction
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node

from iolspi_ros import resources
from launch import LaunchDescription

ARGUMENTS = {
    "task": ("slung_load", "or slung_load_3d"),
    "url": ("udpin:127.0.0.1:14540", "where the autopilot is"),
    "autopilot": ("auto", "px4 or ardupilot, or nothing flies; auto for whoever is there"),
    "system": ("1", "its MAVLink system id"),
    "load": ("feed", "feed or estimate: who says where the load is"),
    "speed_up": ("1.0", "vehicle seconds per second, of a simulator"),
    "autostart": ("configure", "of the bridge: never, configure or activate (which takes off)"),
    "demonstration": ("5", "shipped set, 1 to 5; 0 for none"),
    "checkpoint": ("", "file to go on from, if it is there, and to save to"),
    "seed": ("0", "of bridge and learner"),
    "log": ("", "a .tlog of all that is said to the autopilot and by it"),
    "namespace": ("", "of all nodes"),
}


def nodes(context):
    chosen = {name: LaunchConfiguration(name).perform(context) for name in ARGUMENTS}
    share = get_package_share_directory("iolspi_ros")
    shown, seed = chosen["demonstration"] != "0", int(chosen["seed"])
    parameters = {
        "bridge": {
            "url": chosen["url"], "autopilot": chosen["autopilot"],
            "system": int(chosen["system"]), "load_source": chosen["load"],
            "real_time_factor": float(chosen["speed_up"]), "autostart": chosen["autostart"],
            "log": chosen["log"], "seed": seed,
        },
        "learner": {
            "seed": seed, "background": True, "wait_for_demonstrations": shown,
            "checkpoint": chosen["checkpoint"],
        },
    }  # fmt: skip
    if shown:
        bag = f"{share}/demos/{chosen['task']}/set_{chosen['demonstration']}"
        parameters["demonstrator"] = {"source": "bag", "bags": [bag], "learner_timeout": 0.0}
    return [
        Node(
            package="iolspi_ros",
            executable=name,
            namespace=chosen["namespace"],
            parameters=[str(resources.config(chosen["task"])), values],
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
