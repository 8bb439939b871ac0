"""Launch of a virtual plant and of the twin that follows it by its sensors, and of RViz on request.

ros2 launch cable_twin follow.launch.py plant_set:=carriages.cabin.payload.mass=4200
"""

from launch import LaunchContext, LaunchDescription
from launch.actions import DeclareLaunchArgument, IncludeLaunchDescription, OpaqueFunction, Shutdown
from launch.launch_description_sources import PythonLaunchDescriptionSource
from launch.substitutions import LaunchConfiguration, PathJoinSubstitution
from launch_ros.actions import Node
from launch_ros.parameter_descriptions import ParameterValue
from launch_ros.substitutions import FindPackageShare

ARGUMENTS = {  # default, and what it is
    "scenario": ("aerial_tramway", "name of a scenario, or path of its YAML file, of plant and twin"),
    "plant_set": ("", "what the plant has otherwise than its twin: lines KEY=VALUE with dotted keys of the scenario"),
    "outlook": ("true", "publish outlooks of the twin"),
    "record": ("true", "write logs of plant and twin"),
    "record_directory": ("cable_twin_logs", "where each run makes a directory of its own"),
    "rviz": ("false", "start RViz with the twin in it"),
}
OF_TWIN = ("scenario", "outlook", "record", "record_directory", "rviz")


def plant(context: LaunchContext) -> list[Node]:
    """Describe the plant, with an option for each line of the changes given to it."""
    changes = LaunchConfiguration("plant_set").perform(context).splitlines()
    logs = {
        "record": ParameterValue(LaunchConfiguration("record"), value_type=bool),
        "record_directory": ParameterValue(LaunchConfiguration("record_directory"), value_type=str),
        "rerun": "none",
        "outlook": False,
    }
    return [
        Node(
            package="cable_twin",
            executable="plant",
            arguments=[LaunchConfiguration("scenario"), *(part for change in changes for part in ("--set", change))],
            parameters=[logs],
            output="screen",
            sigterm_timeout="20",  # s, for a disk that takes its time with the logs
            sigkill_timeout="20",
            on_exit=Shutdown(reason="the plant has ended"),
        )
    ]


def generate_launch_description() -> LaunchDescription:
    """Describe the arguments, the twin, whose end ends all as that of the plant does, and the plant."""
    source = PathJoinSubstitution([FindPackageShare("cable_twin"), "launch", "sim.launch.py"])
    return LaunchDescription(
        [
            *(
                DeclareLaunchArgument(name, default_value=default, description=description)
                for name, (default, description) in ARGUMENTS.items()
            ),
            IncludeLaunchDescription(
                PythonLaunchDescriptionSource(source),
                launch_arguments={"follow": "true", **{name: LaunchConfiguration(name) for name in OF_TWIN}}.items(),
            ),
            OpaqueFunction(function=plant),
        ]
    )
