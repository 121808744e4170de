"""One task: simulator, demonstrator and learner, from config/TASK.yaml.

ros2 launch iolspi_ros learn.launch.py task:=slung_load demonstration:=2 mode:=realtime
"""

from ament_index_python.packages import get_package_share_directory
from launch.actions import DeclareLaunchArgument
from launch.substitutions import LaunchConfiguration, PythonExpression
from launch_ros.actions import Node
from launch_ros.parameter_descriptions import ParameterFile, ParameterValue

from launch import LaunchDescription


def generate_launch_description() -> LaunchDescription:
    share = get_package_share_directory("iolspi_ros")
    task, mode, seed = (LaunchConfiguration(name) for name in ("task", "mode", "seed"))
    config = ParameterFile([f"{share}/config/", task, ".yaml"])
    bag = [f"{share}/demos/", task, "/set_", LaunchConfiguration("demonstration")]
    return LaunchDescription(
        [
            DeclareLaunchArgument(
                "task", default_value="pendulum", choices=["pendulum", "slung_load"]
            ),
            DeclareLaunchArgument(
                "mode", default_value="lockstep", choices=["lockstep", "realtime"]
            ),
            DeclareLaunchArgument("demonstration", default_value="5", description="set 1 to 5"),
            DeclareLaunchArgument("seed", default_value="0"),
            DeclareLaunchArgument("checkpoint", default_value="", description="file to save to"),
            Node(
                package="iolspi_ros",
                executable="simulator",
                parameters=[config, {"mode": mode, "seed": seed}],
                output="screen",
            ),
            Node(
                package="iolspi_ros",
                executable="demonstrator",
                parameters=[config, {"source": "bag", "bags": [bag]}],
                output="screen",
            ),
            Node(
                package="iolspi_ros",
                executable="learner",
                parameters=[
                    config,
                    {
                        "seed": seed,
                        "checkpoint": ParameterValue(
                            LaunchConfiguration("checkpoint"), value_type=str
                        ),
                        "background": PythonExpression(["'", mode, "' == 'realtime'"]),
                    },
                ],
                output="screen",
            ),
        ]
    )
