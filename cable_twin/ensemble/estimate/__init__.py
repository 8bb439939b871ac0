"""Estimate of slow quantities and swing of a plant from the plant's sensors, with standard deviations."""
