"""Sections of a scenario, with meaning, unit and allowed values of each key."""
