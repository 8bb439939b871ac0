"""Cases in motion: swings, waves, energy, friction, drives."""
