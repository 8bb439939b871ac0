"""Frames of a simulation: records, snapshots as rows of named columns, commands, signals and sensors."""
