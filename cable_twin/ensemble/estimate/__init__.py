"""Estimate: what a twin learns about its plant from the plant's sensors, with standard deviations."""
