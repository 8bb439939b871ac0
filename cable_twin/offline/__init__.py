"""What needs no ROS: running a scenario, looking at a log, and replaying it."""
