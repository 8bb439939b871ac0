"""Launch of the door of a plant, which is started again should it end.

ros2 launch cable_twin plant_door.launch.py map:=/etc/cable_twin/plant.yaml
"""

from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument, SetEnvironmentVariable
from launch.substitutions import EnvironmentVariable, LaunchConfiguration
from launch_ros.actions import Node

RANGE = "ROS_AUTOMATIC_DISCOVERY_RANGE"


def generate_launch_description() -> LaunchDescription:
    """Describe the argument of the map, and the door."""
    door = Node(
        package="cable_twin",
        executable="plant_door",
        arguments=[LaunchConfiguration("map")],
        output="screen",
        respawn=True,
        respawn_delay=2.0,
        sigterm_timeout="10",  # s, for servers that take leave
    )
    return LaunchDescription(
        [
            DeclareLaunchArgument("map", default_value="plant.yaml", description="YAML file with connections and tags"),
            DeclareLaunchArgument(
                "discovery_range",
                default_value=EnvironmentVariable(RANGE, default_value="LOCALHOST"),
                description=f"{RANGE}: with SUBNET other machines get what the plant measures",
            ),
            SetEnvironmentVariable(RANGE, LaunchConfiguration("discovery_range")),
            door,
        ]
    )
