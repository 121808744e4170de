"""One vehicle and its learner, from config/TASK.yaml.

ros2 launch iolspi_ros learn.launch.py task:=slung_load demonstration:=2 mode:=realtime
ros2 launch iolspi_ros learn.launch.py namespace:=v1 joystick:=true record:=my_set
"""

from ament_index_python.packages import get_package_share_directory
from launch.actions import DeclareLaunchArgument, OpaqueFunction
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node

from iolspi_ros import resources
from launch import LaunchDescription

ARGUMENTS = {
    "task": ("pendulum", "a registered task, or module:Class"),
    "mode": ("lockstep", "lockstep or realtime"),
    "demonstration": ("5", "shipped set, 1 to 5; 0 for none"),
    "joystick": ("false", "demonstrate by joystick (topic joy) instead of a shipped set"),
    "record": ("", "bag to record a demonstration by joystick to"),
    "seed": ("0", "of simulator and learner"),
    "checkpoint": ("", "file to save to"),
    "namespace": ("", "of all three nodes"),
}


def nodes(context):
    chosen = {name: LaunchConfiguration(name).perform(context) for name in ARGUMENTS}
    task, realtime = chosen["task"], chosen["mode"] == "realtime"
    file = resources.config(task)
    shared = [str(file)] if file else []
    bag = f"{get_package_share_directory('iolspi_ros')}/demos/{task}/set_{chosen['demonstration']}"
    by_hand, seed = chosen["joystick"] == "true", int(chosen["seed"])
    shown = by_hand or chosen["demonstration"] != "0"
    if by_hand:
        demonstration = {"source": "joy", "record": chosen["record"]}
    else:
        demonstration = {"source": "bag", "bags": [bag]}
    learner = {"seed": seed, "checkpoint": chosen["checkpoint"], "background": realtime}
    parameters = {
        "simulator": {"task": task, "mode": chosen["mode"], "seed": seed},
        "learner": learner | {"wait_for_demonstrations": shown},
    } | ({"demonstrator": demonstration} if shown else {})  # fmt: skip
    return [
        Node(
            package="iolspi_ros",
            executable=name,
            namespace=chosen["namespace"],
            parameters=[*shared, values],
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
