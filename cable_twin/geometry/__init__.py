"""Outlines of vehicles, and clearance of rope and vehicles over the ground."""
