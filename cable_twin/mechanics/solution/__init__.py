"""Equations of the whole system and their solvers: equilibrium, time integration, natural modes."""
