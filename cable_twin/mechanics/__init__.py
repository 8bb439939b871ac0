"""Ropes, vehicles and joints as one differential-algebraic system (Seo, Jung, Han, Park 2004), compiled by numba."""
