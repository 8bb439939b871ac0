"""Scenarios from surveys: reading of terrain and towers, scenarios of usual ropeways, and their design."""
