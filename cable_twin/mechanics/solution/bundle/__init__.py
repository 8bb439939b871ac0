"""Several ropes, and what couples them: each stays a system of its own, block-tridiagonal along itself."""
