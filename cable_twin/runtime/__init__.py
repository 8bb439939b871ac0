"""The loop of a running twin: frames on time, goals, pace and watches, without any of ROS."""
