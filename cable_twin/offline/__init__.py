"""What needs no ROS: replaying a log."""
