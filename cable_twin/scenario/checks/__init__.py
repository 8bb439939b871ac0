"""Checks of a scenario: values that exclude each other, and the faults that report them."""
