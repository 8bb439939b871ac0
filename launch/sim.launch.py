"""Launch of a twin with its logs, and of RViz on request.

ros2 launch cable_twin sim.launch.py scenario:=chairlift rviz:=true
"""

from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument, SetEnvironmentVariable, Shutdown
from launch.conditions import IfCondition
from launch.substitutions import EnvironmentVariable, LaunchConfiguration, PathJoinSubstitution
from launch_ros.actions import Node
from launch_ros.parameter_descriptions import ParameterValue
from launch_ros.substitutions import FindPackageShare

RANGE = "ROS_AUTOMATIC_DISCOVERY_RANGE"
ARGUMENTS = {  # default, and what it is
    "scenario": ("aerial_tramway", "name of a scenario, or path of its YAML file"),
    "set": ("", "changed values of the scenario: lines KEY=VALUE with dotted keys, as in wind.x=12"),
    "namespace": ("", "in front of the node's name: /NAMESPACE/cable_twin"),
    "frame_prefix": ("", "in front of the names of its frames, as in 'south/', for several twins in one tree"),
    "record": ("true", "write logs"),
    "record_directory": ("cable_twin_logs", "where each run makes a directory of its own"),
    "rerun": ("file", "rerun recording: none, file, live or web"),
    "real_time_factor": ("1.0", "simulated seconds in a second, 0 for as fast as possible"),
    "outlook": ("true", "publish outlooks: what happens in an emergency stop, as commanded, and in a gust"),
    "follow": ("false", "follow the plant that publishes under /plant/, and publish estimates"),
    "start_paused": ("false", "wait for the service ~/pause or ~/step"),
    "publish_clock": ("false", "publish simulated time on /clock"),
    "rviz": ("false", "start RViz with the twin in it"),
}
FLAGS = ("record", "outlook", "follow", "start_paused", "publish_clock")
TYPES = {**dict.fromkeys(FLAGS, bool), "real_time_factor": float}  # others are texts
SHOWN = ("markers", "robot_description", "cable_path", "cable")  # what the layout of RViz subscribes to


def generate_launch_description() -> LaunchDescription:
    """Describe the arguments, the twin, and RViz."""
    namespace = LaunchConfiguration("namespace")
    own = [name for name in ARGUMENTS if name not in ("namespace", "rviz")]
    twin = Node(
        package="cable_twin",
        executable="sim",
        namespace=namespace,
        parameters=[{name: ParameterValue(LaunchConfiguration(name), value_type=TYPES.get(name, str)) for name in own}],
        output="screen",
        sigterm_timeout="20",  # s, for a disk that takes its time with the logs
        sigkill_timeout="20",
        on_exit=Shutdown(),
    )
    rviz = Node(
        package="rviz2",
        executable="rviz2",
        namespace=namespace,
        arguments=["-d", PathJoinSubstitution([FindPackageShare("cable_twin"), "rviz", "cable_twin.rviz"])],
        remappings=[(f"/cable_twin/{name}", f"cable_twin/{name}") for name in SHOWN],
        condition=IfCondition(LaunchConfiguration("rviz")),
    )
    return LaunchDescription(
        [
            DeclareLaunchArgument(
                "discovery_range",
                default_value=EnvironmentVariable(RANGE, default_value="LOCALHOST"),
                description=f"{RANGE}: with SUBNET other machines see the twin, and may command it",
            ),
            *(
                DeclareLaunchArgument(name, default_value=default, description=description)
                for name, (default, description) in ARGUMENTS.items()
            ),
            SetEnvironmentVariable(RANGE, LaunchConfiguration("discovery_range")),
            twin,
            rviz,
        ]
    )
