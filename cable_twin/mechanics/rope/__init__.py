"""Rope finite elements: elastic models, loads along the element, joint compliance, points on the rope."""
