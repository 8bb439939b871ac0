"""Readout of a state: shape, tension, reactions, energies and clearances."""
