"""Launch of two twins, each with its own namespace, tree of frames and log directory.

ros2 launch cable_twin two_lifts.launch.py valley:=gondola summit:=chairlift
"""

from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument, GroupAction, IncludeLaunchDescription
from launch.launch_description_sources import PythonLaunchDescriptionSource
from launch.substitutions import LaunchConfiguration, PathJoinSubstitution
from launch_ros.substitutions import FindPackageShare

LIFTS = {"valley": "aerial_tramway", "summit": "chairlift"}  # namespace and default scenario


def generate_launch_description() -> LaunchDescription:
    """Describe a scenario argument for each namespace, and both twins."""
    source = PathJoinSubstitution([FindPackageShare("cable_twin"), "launch", "sim.launch.py"])
    shared = ("record", "rviz")
    return LaunchDescription(
        [
            *(
                DeclareLaunchArgument(name, default_value=scenario, description=f"scenario of the twin in /{name}")
                for name, scenario in LIFTS.items()
            ),
            DeclareLaunchArgument("record", default_value="true", description="write logs"),
            DeclareLaunchArgument("rviz", default_value="false", description="start RViz for each of them"),
            *(
                GroupAction(
                    [
                        IncludeLaunchDescription(
                            PythonLaunchDescriptionSource(source),
                            launch_arguments={
                                "scenario": LaunchConfiguration(name),
                                "namespace": name,
                                "frame_prefix": f"{name}/",
                                "record_directory": f"cable_twin_logs/{name}",
                                **{argument: LaunchConfiguration(argument) for argument in shared},
                            }.items(),
                        )
                    ]
                )
                for name in LIFTS
            ),
        ]
    )
