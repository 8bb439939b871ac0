"""Detectors of faults of a followed plant and of its sensors, which raise alarms; a module for each kind of fault.

- `sensor_faults`: sensors that are stuck, of another unit or sign, swapped, or that contradict all others all at once,
  and a drive that needs another force; encoders that jump, by `jumps`.
- `biases`: load cells that are wrong by a constant, by all measurements; `encoder_zeros`: encoders that are.
- `departures`: payload, friction, ice or a counterweight that is not as in the scenario, or that changes suddenly,
  which `changes` finds out.
- `counterweights`: those that are stuck.
- `silences`: sensors that say nothing.
- `emergency_stops`: those of the plant, by its encoders and drive forces.
- `unlike_motion`: a drive of a lift that moves otherwise than the twin's.

`windows` has the measurements between two corrections, and asks which of these faults they show.
"""
