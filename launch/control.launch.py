"""Launch of a control experiment: a twin, a controller with damped swing, and the recording of both.

ros2 launch cable_twin control.launch.py to:=160 speed:=5
"""

from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument, ExecuteProcess, IncludeLaunchDescription, Shutdown
from launch.launch_description_sources import PythonLaunchDescriptionSource
from launch.substitutions import LaunchConfiguration, PathJoinSubstitution
from launch_ros.substitutions import ExecutableInPackage, FindPackageShare

ARGUMENTS = {  # default, and what it is
    "scenario": ("single_span", "name of a scenario, or path of its YAML file"),
    "controller": ("swing_damping.py", "swing_damping.py, trapezoid_driver.py, or an executable with their options"),
    "carriage": ("cabin", "carriage to drive"),
    "to": ("160", "arc length to drive to, in m"),
    "speed": ("5", "speed on the way, in m/s"),
    "record_directory": ("cable_twin_logs", "where the run makes a directory of its own"),
    "rviz": ("false", "start RViz with the twin in it"),
}


def generate_launch_description() -> LaunchDescription:
    """Describe the arguments, the twin with its logs, and the controller, whose end ends all."""
    source = PathJoinSubstitution([FindPackageShare("cable_twin"), "launch", "sim.launch.py"])
    passed = ("scenario", "record_directory", "rviz")
    controller = ExecuteProcess(
        cmd=[
            ExecutableInPackage(executable=LaunchConfiguration("controller"), package="cable_twin"),
            LaunchConfiguration("carriage"),
            "--to",
            LaunchConfiguration("to"),
            "--speed",
            LaunchConfiguration("speed"),
            "--wait",
            "120",  # s, for a twin that compiles its solver first
        ],
        output="screen",
        on_exit=Shutdown(reason="the controller has ended"),
    )
    return LaunchDescription(
        [
            *(
                DeclareLaunchArgument(name, default_value=default, description=description)
                for name, (default, description) in ARGUMENTS.items()
            ),
            IncludeLaunchDescription(
                PythonLaunchDescriptionSource(source),
                launch_arguments={"record": "true", **{name: LaunchConfiguration(name) for name in passed}}.items(),
            ),
            controller,
        ]
    )
