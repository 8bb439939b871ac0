"""The equations of the whole system, and what solves them: at rest, in time, for small oscillations."""
