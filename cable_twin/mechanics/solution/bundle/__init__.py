"""Coupled ropes: several block-tridiagonal systems, and the couplings between them."""
