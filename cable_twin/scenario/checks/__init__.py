"""Checks of a scenario for values that contradict each other, and the error messages about them."""
