"""Drives of vehicles and ropes: references, haul ropes, axially moving ropes, stations."""
