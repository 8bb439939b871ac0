"""Rope finite elements: elastic models, loads along the element, nodes at loads, points on the rope."""
