"""Key figures of a run, updated frame by frame: ropes, supports, drives, vehicles, bullwheels and couplings."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from itertools import combinations_with_replacement, pairwise
from math import atan2, degrees, hypot, inf, isnan, nan, sqrt

import numpy as np

from cable_twin.frame.records import AppliedCommand, Touch
from cable_twin.frame.snapshot import DERAILED as WAYS_OUT
from cable_twin.frame.snapshot import ENDS, Layout, Snapshot
from cable_twin.geometry.ground import surroundings_of
from cable_twin.key_figures.dissipation import Dissipation
from cable_twin.key_figures.extremes import (
    PLACE,
    ROPE,
    TIME,
    VALUE,
    WIND,
    boxes_of,
    constants_of,
    masts_of,
    no_extremes,
    passes,
    ropes_of,
    supports_of,
)
from cable_twin.key_figures.extremes_by_frame import (
    CLEARANCE_PERIOD,
    MEAN,
    take_frame,
    take_passing,
    take_surroundings,
)
from cable_twin.key_figures.figure import KeyFigure, Subject, figure, haul_rope_of
from cable_twin.key_figures.stops import CarriedStops, DriveStops, Group, SeatStops, groups_of
from cable_twin.mechanics.language.by_reference import pack
from cable_twin.mechanics.language.declared import Memory
from cable_twin.mechanics.parameters import FREE, FloatArray
from cable_twin.scenario import Scenario
from cable_twin.scenario.command_limits import unbraked
from cable_twin.scenario.sections.drives import Limits

EVERY_STEP = "sampled at every solver step"
LOOKS = f"samples taken every {CLEARANCE_PERIOD:g} s"
UNFILTERED = "sampled at every frame, unfiltered; EN 50318 filters it with a low-pass of 20 Hz"
# assumed: ropeway standards specify no filter; anything shorter than 0.2 s is felt as a shock
MEANS = (
    f"smoothed twice with a moving average over {MEAN:g} s (-3 dB at {0.319 / MEAN:.1f} Hz); assumed, as no ropeway "
    "standard specifies a filter"
)
ASSUMED_RATIO = "assumed: flanks of 45 degrees with a friction of 0.3 hold up to 0.54 (Nadal)"
IN_PLACE = "assumed: the rope stays on its towers"
SIDES = ("onto it", "off it")  # of the strands that come to a bullwheel and leave it
BEYOND = "above 1 the rope slips on the wheel; from 1 mm on, `slip of the rope` gives the distance"
UPRIGHT = 90  # deg, of a wind straight up or down, which has no heading
STILL = 1e-3  # m, of slip, below which there was none


class KeyFigures:
    """Key figures of one run, updated frame by frame.

    Args:
        scenario: scenario of the run; figures are compared with its `limits` and the limits of its drives.
        rest: snapshot at rest, over whose tension the dynamic amplification is; None for the first one of the run.
            Where that is later than time zero, the amplification is not judged.
    """

    def __init__(self, scenario: Scenario, rest: Snapshot | None = None) -> None:
        self._scenario, self._ropes, self._rope_names = scenario, ropes_of(scenario), list(scenario.cables)
        self._vehicles, self._supports = list(scenario.vehicles), supports_of(scenario)
        self._drives, self._sheaves = list(scenario.drives), list(scenario.sheaves)
        self._extremes, self._rest_known = no_extremes(scenario), rest is not None
        if rest is not None:
            self._extremes.first_tension[:] = rest.columns.highest_tension[:, 0]
        self._layout: Layout | None = None  # of the frames so far
        self._next_look = -inf  # s, at which clearances are due
        in_space = scenario.dim == 3
        self._around = pack(surroundings_of(scenario)) if in_space or scenario.terrain else None
        self._boxes = pack(boxes_of(scenario)) if passes(scenario) else None
        self._masts = masts_of(scenario) if in_space else []
        self._wind = 0.0, nan  # m/s, the strongest so far, and its time (s)
        self._first, self._last, self._period = nan, nan, nan  # s, of the first frame, the last one, between two
        self._groups = groups_of(scenario)
        driven = {
            name: Subject(f"carriages.{name}", name)
            for name, one in scenario.carriages.items()
            if one.joint == "sliding" and not one.clamped_to
        }
        subjects = driven | {name: Subject(f"drives.{name}", name) for name in self._drives}
        on_bullwheels = {name for name, one in scenario.drives.items() if one.sheave}
        self._unbraked = unbraked(scenario)
        self._stops = DriveStops(subjects, self._motion, self._obeys, on_bullwheels)
        self._carried, self._seats = CarriedStops(scenario), SeatStops(scenario)
        self._dissipation = Dissipation(scenario)

    def update(self, snapshot: Snapshot) -> None:
        """Update the key figures with one snapshot, in order of time.

        Raises:
            ValueError: the snapshot is of another scenario.
        """
        if snapshot.layout is not self._layout:
            self._take_layout(snapshot.layout)
        self._carried.update(snapshot)
        self._seats.update(snapshot)
        time = snapshot.time
        passed = time - self._last
        if passed > 0.0 and not passed >= self._period:
            self._period = passed
        self._first = time if isnan(self._first) else self._first
        self._last = time
        self._dissipation.update(time, snapshot.solver)
        self._numbers[:] = snapshot.numbers
        take_frame(*self._packed, self._packed_columns)
        if self._around is not None and time >= self._next_look:
            self._next_look = time + CLEARANCE_PERIOD * (1.0 - 1e-9)
            take_surroundings(*self._packed, self._around, self._packed_columns)
            if self._boxes is not None:
                take_passing(self._packed[0], self._boxes, self._packed_columns)
        self._stops.update(time)
        wind = hypot(*self._columns.wind.tolist()) if self._scenario.dim == 3 else nan
        if wind > self._wind[0]:
            self._wind = wind, time

    def _take_layout(self, layout: Layout) -> None:
        """Allocate the columns into which every frame of a layout is copied, and the constants of the scenario."""
        scenario = self._scenario
        names = {name: tuple(vehicle.bodies) for name, vehicle in scenario.vehicles.items()}
        others = [*scenario.pantographs, *scenario.connectors]
        own = names, [one.name for one in self._supports], self._drives, self._sheaves, others
        theirs = layout.vehicles, [*layout.supports], [*layout.drives], [*layout.sheaves]
        if own != (*theirs, [*layout.pantographs, *layout.connectors]):
            raise ValueError("snapshot: given other names of vehicles, supports or drives; allowed: the scenario's")
        self._layout, self._constants = layout, constants_of(scenario, layout)
        self._packed = pack(self._extremes), pack(self._constants)
        self._numbers = np.empty(layout.size)
        self._columns = layout.columns(self._numbers)
        self._packed_columns = pack(self._columns)

    def command(self, applied: AppliedCommand) -> None:
        """Update the key figures with a command at the time of its effect."""
        if applied.command.kind == "reset":  # accelerations start anew
            self._extremes.passed_time[:] = nan
        for stops in (self._stops, self._carried, self._seats):
            stops.command(applied)

    def touches(self) -> list[Touch]:
        """Return the last contact of each vehicle with a vehicle after it on its rope."""
        return [self._touch(row, touch) for row, touch in enumerate(self._extremes.touch) if not isnan(touch[0])]

    def extremes(self) -> Memory:
        """Copy of all extremes so far, for `figures_with`: much cheaper than key figures."""
        return self._extremes.memory.copy()

    def figures_with(self, extremes: Memory) -> list[KeyFigure]:
        """Return the key figures of an earlier moment of this run, from the copy of `extremes` made then."""
        memory = self._extremes.memory
        present = memory.copy()
        memory[:] = extremes
        try:
            return self.figures()
        finally:
            memory[:] = present

    def figures(self) -> list[KeyFigure]:
        """Return all key figures that have a value."""
        if self._layout is None:
            return []
        frames = "" if isnan(self._period) else f"samples taken every {self._period:.4g} s"
        found = []
        for rope in range(len(self._ropes)):
            of_rope = [
                *self._of_rope(rope),
                *self._of_supports(rope),
                *(one for name in self._drives if not self._sheaves for one in self._of_drive(name)),
                *(
                    one
                    for group in self._groups
                    if self._reported_with(group, rope)
                    for one in self._of_vehicles(group, rope)
                ),
                *self._of_buffers(rope),
            ]
            found += [replace(one, band=frames) if frames and not one.band else one for one in of_rope]
        if self._sheaves:
            found += [one for name in self._drives for one in self._of_drive(name)]
            found += [one for row, name in enumerate(self._sheaves) for one in self._of_sheave(row, name)]
            found += self._of_loads()
        found += [one.limited_by(self._scenario) for one in self._carried.figures()]
        found += [*self._seats.figures(), *self._of_couplings(), *self._of_passing()]
        if self._wind[0] > 0.0:
            found.append(figure("wind", Subject("air"), "highest", *self._wind))
        found.append(self._dissipation.figure(self._last))
        return [one for one in found if not isnan(one.value)]

    def _motion(self, name: str) -> tuple[float, float]:
        """Position (m) and speed (m/s) of a drive or a driven vehicle in the last frame."""
        c = self._columns
        if name in self._drives:
            index = self._drives.index(name)
            return float(c.drive_position[index]), float(c.drive_speed[index])
        index = self._vehicles.index(name)
        return float(c.arc_length[index]), float(c.speed[index])

    def _obeys(self, name: str) -> bool:
        """Whether an emergency stop after the last frame acts on a drive or a driven vehicle."""
        return name not in self._unbraked or self._columns.command_kind[self._vehicles.index(name)] != FREE

    def _rope(self, rope: int, place: str = "") -> Subject:
        """Subject of a rope or a part of a rope, printed with the name of the rope among several."""
        name = self._rope_names[rope]
        return Subject(f"ropes.{name}{place}", name if self._scenario.ropes else "")

    def _of_rope(self, rope: int) -> Iterator[KeyFigure]:
        scenario, subject, extremes = self._ropes[rope], self._rope(rope), self._extremes
        highest = extreme("rope_tension", subject, "highest", extremes.tension[rope])
        yield highest
        yield extreme("rope_tension", subject, "lowest", extremes.lowest_tension[rope])
        breaking_force, first, reached = scenario.cable.breaking_force, extremes.first_tension[rope], highest.time
        if breaking_force is not None and highest.value > 0.0:
            factor = breaking_force / highest.value
            one = figure("rope_safety_factor", subject, "lowest", factor, reached, highest.place)
            yield one.limited_by(scenario)
        if first > 0.0:
            ratio = highest.value / float(first)
            begun = self._first > 0.0 and not self._rest_known
            since = f"over that at {self._first:.2f} s, where the run begins" if begun else ""
            place = ", ".join(filter(None, (highest.place, since)))
            one = figure("dynamic_amplification", subject, "highest", ratio, reached, place)
            yield one if begun else one.limited_by(scenario)
        spans = list(pairwise(["start", *scenario.towers, "end"]))
        for number, (start, end) in enumerate(spans, self._constants.first_support[rope]):
            span = self._rope(rope, f".{start}+{end}")
            detail = "" if len(spans) == 1 else f", {start} to {end}"
            yield extreme("sag", span, "highest", extremes.sag[number], "x", detail=detail).limited_by(scenario)
        clearance = extreme("rope_clearance", subject, "lowest", extremes.rope_clearance[rope], "x")
        yield replace(clearance.limited_by(scenario), band=LOOKS)

    def _of_supports(self, rope: int) -> Iterator[KeyFigure]:
        scenario, extremes = self._ropes[rope], self._extremes
        first, last = self._constants.first_support[rope : rope + 2]
        for row in range(first, last):
            subject, end = self._supports[row], ENDS[row - first] if row - first < len(ENDS) else ""
            load = extreme("support_load", subject, "highest", extremes.load[row])
            yield load.limited_by(scenario)
            yield extreme("support_load", subject, "lowest", extremes.lowest_load[row])
            margin = extreme("deropement_margin", subject, "lowest", extremes.margin[row])
            if margin.value == 0.0 and load.value == 0.0:
                margin = replace(margin, place="does not touch")
            yield replace(margin.limited_by(scenario), band=EVERY_STEP)
            roller = extreme("roller_load", subject, "lowest", extremes.roller_load[row])
            count = int(self._constants.rollers[row])
            touches = f"mean of {count} rollers" if count > 1 else "one roller"
            roller = replace(roller, place="does not touch" if load.value == 0.0 else touches)
            yield replace(roller.limited_by(scenario), band=EVERY_STEP)
            if self._constants.in_space and not end:
                yield from self._of_groove(subject, row, scenario)
            travel = getattr(scenario.cable, end).travel if end else None
            low, high = travel or (None, None)
            source = f"scenario: {self._scenario.rope_key(self._rope_names[rope])}.{end}.travel"
            yield extreme("counterweight_travel", subject, "highest", extremes.travel[row]).limited(high, source)
            yield extreme("counterweight_travel", subject, "lowest", extremes.lowest_travel[row]).limited(low, source)

    def _of_groove(self, subject: Subject, row: int, scenario: Scenario) -> Iterator[KeyFigure]:
        """Key figures of the rope in the groove of a tower in space: lateral force and ratio, derailment."""
        extremes, name = self._extremes, subject.name
        tower = scenario.towers[name]
        yield extreme("lateral_force", subject, "highest", extremes.lateral[row])
        ratio = extreme("lateral_ratio", subject, "highest", extremes.lateral_ratio[row])
        own = tower.derailment_ratio != type(tower).model_fields["derailment_ratio"].default
        source = f"scenario: towers.{name}.derailment_ratio" if own else ASSUMED_RATIO
        yield replace(ratio.limited(tower.derailment_ratio, source), band=EVERY_STEP)
        kind, time = extremes.derailed[row, VALUE], float(extremes.derailed[row, TIME])
        if kind > 0.0:
            x, y, z = scenario.vector(tower.position)
            place = f"x {x:.1f}, y {y:.1f}, z {z:.1f} m, {WAYS_OUT[int(kind)]}, {wind_at(extremes.derailed[row])}"
            one = figure("derailed", subject, "highest", 1.0, time, place).limited(0.0, IN_PLACE)
            yield replace(one, band=EVERY_STEP)

    def _of_drive(self, name: str) -> Iterator[KeyFigure]:
        """Key figures of a drive of ropes."""
        subject, source = Subject(f"drives.{name}", name), f"scenario: {self._scenario.drive_key(name)}.limits"
        row, drive = len(self._vehicles) + self._drives.index(name), self._scenario.drives[name]
        at = "rope travel" if drive.sheave is None else "rim travel"  # by which a rope that slips is behind
        yield from self._of_motion(subject, row, drive.limits, source, at)
        yield from (one.limited_by(self._scenario) for one in self._stops.figures(name))

    def _of_motion(
        self, subject: Subject, row: int, limits: Limits, source: str, at: str = "arc length", *, hauled: bool = False
    ) -> Iterator[KeyFigure]:
        """Key figures of the motion of a driven vehicle or a drive; `at` names the coordinate of the place.

        The limit of the speed is one of the drive: of a vehicle that is `hauled` it holds at the drum of its haul rope.
        """
        extremes, least = self._extremes, None if limits.power is None else -limits.power
        speed = extreme("speed", subject, "highest", extremes.speed[row], at)
        if hauled:
            yield speed
            speed = extreme("drive_speed", subject, "highest", extremes.drive_speed[row], at)
        yield speed.limited(limits.speed, f"{source}.speed")
        force = extreme("drive_force", subject, "highest", extremes.force[row], at)
        yield force.limited(limits.force, f"{source}.force")
        power = extreme("drive_power", subject, "highest", extremes.power[row], at)
        yield power.limited(limits.power, f"{source}.power")
        braking = extreme("drive_power", subject, "lowest", extremes.lowest_power[row], at)
        yield braking.limited(least, f"{source}.power")

    def _reported_with(self, group: Group, rope: int) -> bool:
        """Whether a vehicle group is listed with a rope: a carriage with its own rope, carriers with their last one."""
        name = group.subject.name
        if group.subject.key == "carriers":
            return rope == max(number for number, one in enumerate(self._ropes) if one.carriers is not None)
        return name in self._ropes[rope].carriages

    def _of_vehicles(self, group: Group, rope: int) -> Iterator[KeyFigure]:
        """Key figures of a carriage, or of the worst vehicle of a group."""
        scenario, subject, extremes = self._ropes[rope], group.subject, self._extremes
        carriage = scenario.carriages.get(subject.name)
        if carriage is None or carriage.joint == "clamped" or carriage.clamped_to:
            yield self._worst("speed", group, "highest", extremes.speed)
        else:
            source = f"scenario: carriages.{subject.name}.drive.limits"
            hauled = carriage.drive.haul_rope is not None
            yield from self._of_motion(subject, group.rows[0], carriage.drive.limits, source, hauled=hauled)
        if carriage is not None and carriage.joint != "clamped":
            yield from self._of_haul_rope(subject.name, group.rows[0])
            yield extreme("brake_force", subject, "highest", extremes.brake_force[group.rows[0]])
            yield extreme("end_stop_speed", subject, "highest", extremes.end_stop_speed[group.rows[0]])
        acceleration = self._worst("acceleration", group, "highest", extremes.acceleration)
        yield replace(acceleration.limited_by(scenario), band=MEANS)
        yield self._worst("swing", group, "highest", extremes.swing).limited_by(scenario)
        if self._constants.in_space:
            yield self._worst("lateral_swing", group, "highest", extremes.roll).limited_by(scenario)
            clearance = self._worst("tower_clearance", group, "lowest", extremes.mast_clearance, "mast")
            yield replace(clearance.limited_by(scenario), band=LOOKS)
        yield self._worst("contact_force", group, "highest", extremes.contact_force)
        yield self._worst("haul_force", group, "highest", extremes.haul_force)
        ratio = self._worst("tension_per_transverse_load", group, "lowest", extremes.tension_over_load)
        yield ratio.limited_by(scenario, clamped=bool(self._constants.clamped[group.rows[0]]))
        height = self._worst("vehicle_clearance", group, "lowest", extremes.clearance, "x")
        yield replace(height.limited_by(scenario), band=LOOKS)
        if carriage is not None:
            yield from (one.limited_by(scenario) for one in self._stops.figures(subject.name))

    def _of_haul_rope(self, name: str, row: int) -> Iterator[KeyFigure]:
        """Key figures of the haul rope in the drive of a carriage."""
        rope = self._scenario.haul_ropes.get(name)
        if rope is None:
            return
        subject = haul_rope_of(self._scenario, name)
        tension = extreme("rope_tension", subject, "highest", self._extremes.haul_tension[row])
        yield tension
        if rope.breaking_force is not None and tension.value > 0.0:
            factor = rope.breaking_force / tension.value
            one = figure("rope_safety_factor", subject, "lowest", factor, tension.time, tension.place)
            yield one.limited_by(self._scenario, hauls=True)

    def _worst(
        self, quantity: str, group: Group, statistic: str, extremes: FloatArray, at: str = "arc length"
    ) -> KeyFigure:
        """Key figure of the worst vehicle of a group; its place names the vehicle if several, and a carrier's rope."""
        row = worst_of(extremes, group.rows, statistic)
        found, mast = extreme(quantity, group.subject, statistic, extremes[row], at), extremes[row, PLACE]
        if isnan(found.value):
            return found
        place = found.place
        if at == "mast":
            place = ", ".join(filter(None, (self._masts[int(mast)], wind_at(extremes[row]))))
        place = place if len(group.rows) == 1 else f"{self._vehicles[row]}, {place}"
        if group.subject.key == "carriers" and self._scenario.ropes:
            place = f"{self._rope_names[int(extremes[row, ROPE])]}: {place}"
        return replace(found, place=place)

    def _touch(self, row: int, touch: FloatArray) -> Touch:
        """Contact of a vehicle with a vehicle after it on its rope, from a row of the stored contacts."""
        other, place, speed, time = touch.tolist()
        return Touch(self._vehicles[row], self._vehicles[int(other)], time, place, speed)

    def _of_buffers(self, rope: int) -> Iterator[KeyFigure]:
        """Highest buffer force of each pair of vehicles of a rope that have been in contact."""
        for row in np.flatnonzero(~np.isnan(self._extremes.push[:, VALUE])).tolist():
            if max(self._constants.vehicle_rope[row], 0) != rope:
                continue
            touch = self._touch(row, self._extremes.push_touch[row])
            keys = [f"carriages.{name}" for name in (touch.vehicle, touch.other)]
            subject = Subject("+".join(keys), f"{touch.vehicle} and {touch.other}")
            place = f"met at {touch.speed:.3g} m/s at {touch.time:.2f} s, arc length {touch.place:.1f} m"
            one = extreme("buffer_force", subject, "highest", self._extremes.push[row])
            yield replace(one, place=place, band=EVERY_STEP)

    def _of_sheave(self, row: int, name: str) -> Iterator[KeyFigure]:
        """Key figures of a bullwheel."""
        extremes, sheave, subject = self._extremes, self._scenario.sheaves[name], Subject(f"sheaves.{name}", name)
        for side, (joined, where) in enumerate(zip(sheave.joins, SIDES, strict=True)):
            rope = joined.partition(".")[0]
            strand = Subject(f"sheaves.{name}.{rope}", name)
            for kept, which in ((extremes.side_tension, "highest"), (extremes.lowest_side_tension, "lowest")):
                one = extreme("strand_tension", strand, which, kept[row, side], detail=rope)
                yield replace(one, place=f"runs {where}")
        adhesion = extreme("adhesion_used", subject, "highest", extremes.adhesion[row])
        source = f"scenario: sheaves.{name}, friction {sheave.friction:g} times wrap {sheave.wrap:.4g} rad: {BEYOND}"
        yield adhesion.limited(1.0, source)
        slip = extreme("rope_slip", subject, "highest", extremes.slip[row])
        if slip.value > STILL:
            yield slip
        if sheave.rollback is not None:
            one = extreme("rollback", subject, "highest", extremes.rolled_back[row])
            source = f"scenario: sheaves.{name}.rollback of {sheave.rollback:g} m"
            yield replace(one, place="1 stands for yes, 0 for no").limited(0.0, source)
        if any(drive.sheave == name for drive in self._scenario.drives.values()):
            yield extreme("drive_torque", subject, "highest", extremes.torque[row])
        if sheave.tensioning is not None:
            low, high = sheave.tensioning.travel
            kind = "counterweight" if sheave.counterweight else "hydraulics"
            source = f"scenario: sheaves.{name}.{kind}.travel"
            yield extreme(f"{kind}_travel", subject, "highest", extremes.sheave_travel[row]).limited(high, source)
            yield extreme(f"{kind}_travel", subject, "lowest", extremes.lowest_sheave_travel[row]).limited(low, source)
        for kept, which in ((extremes.sheave_pull, "highest"), (extremes.lowest_sheave_pull, "lowest")):
            yield extreme("hydraulics_pull", subject, which, kept[row])  # none without a hydraulic tensioner

    def _of_loads(self) -> Iterator[KeyFigure]:
        """Load of the carriers on each rope from which carriers hang, as key figures."""
        if self._scenario.carriers is not None:
            for row, rope in enumerate(self._scenario.ropes):
                if rope not in self._scenario.carriers.tracks:  # else they hang from its track
                    load = extreme("carried_load", self._rope(row), "highest", self._extremes.carried[row])
                    yield replace(load, place="carriers and payload")

    def _of_couplings(self) -> Iterator[KeyFigure]:
        """Figures of pantographs, of clamps on haul ropes and of connectors between ropes."""
        extremes, scenario = self._extremes, self._scenario
        for row, name in enumerate(scenario.pantographs):
            frames, subject = float(extremes.frames[row]), Subject(f"pantographs.{name}", name)
            if not frames:
                continue
            mean, deviation = float(extremes.mean_force[row]), sqrt(extremes.square_force[row] / frames)
            share, end, left = 100.0 * float(extremes.lost[row]) / frames, extremes.last_force[row], extremes.left[row]
            until = float(end), "" if isnan(left) else f"has left its wire at {left:.2f} s"
            found = [
                figure("pantograph_force", subject, "mean", mean, *until),
                figure("pantograph_force", subject, "standard deviation", deviation, *until),
                extreme("pantograph_force", subject, "highest", extremes.pantograph_force[row], "x"),
                extreme("pantograph_force", subject, "lowest", extremes.lowest_pantograph_force[row], "x"),
                figure("contact_loss", subject, "mean", share, *until),
            ]
            yield from (replace(one, band=UNFILTERED) for one in found)
        rides_tracks = scenario.carriers is not None and scenario.carriers.tracks
        for group in self._groups:
            carriage = scenario.carriages.get(group.subject.name)
            if carriage.clamped_to if carriage is not None else rides_tracks:
                row = worst_of(extremes.force, group.rows, "highest")
                detail, which = ("the", f"{self._vehicles[row]}, ") if len(group.rows) > 1 else ("its", "")
                one = extreme("clamp_force", group.subject, "highest", extremes.force[row], detail=detail)
                yield replace(one, place=f"{which}{one.place}")
        if scenario.connectors:
            names, subject = list(scenario.connectors), Subject("connectors", "connectors")
            most, longest = worst_of(extremes.pull, range(len(names)), "highest"), int(np.argmax(extremes.slack))
            yield replace(extreme("connector_force", subject, "highest", extremes.pull[most]), place=names[most])
            slack = float(extremes.slack[longest])
            yield figure("connector_slack", subject, "highest", slack, self._last, names[longest])

    def _of_passing(self) -> Iterator[KeyFigure]:
        """Least clearance in the run of each two carriages, or carriages and carriers, that came near each other."""
        count = len(self._groups) if self._boxes is not None else 0
        for one, other in combinations_with_replacement(range(count), 2):
            row = one * count + other
            if not self._extremes.separation[row, VALUE] >= 0.0:
                continue
            both = [self._groups[number].subject for number in dict.fromkeys((one, other))]
            subject, names = Subject("+".join(each.key for each in both)), " and ".join(each.name for each in both)
            found = extreme("vehicle_separation", subject, "lowest", self._extremes.separation[row], detail=names)
            who, beside = (self._vehicles[number] for number in self._extremes.separated[row].tolist())
            place = f"{who} at {found.place}" if one != other else f"{who} and {beside}, {found.place}"
            yield replace(replace(found, place=place).limited_by(self._scenario), band=LOOKS)


def compile_figures(scenario: Scenario, first: Snapshot) -> None:
    """Compile the kernels of the key figures on the first snapshot of a run, before its frames are due."""
    KeyFigures(scenario).update(first)


def extreme(
    quantity: str, subject: Subject, statistic: str, row: FloatArray, at: str = "arc length", *, detail: str = ""
) -> KeyFigure:
    """Key figure of one extreme, without a limit; NaN before its first value.

    Args:
        quantity: row of `QUANTITIES`.
        subject: subject of the figure.
        statistic: highest or lowest.
        row: (EXTREME,) the extreme.
        at: name of the coordinate of the place.
        detail: for the {} of the name.
    """
    where = "" if isnan(row[PLACE]) else f"{at} {round(float(row[PLACE]), 1) + 0.0:.1f} m"
    place = ", ".join(filter(None, (where, wind_at(row))))
    return figure(quantity, subject, statistic, float(row[VALUE]), float(row[TIME]), place, detail=detail)


def wind_at(row: FloatArray) -> str:
    """Wind at the time of an extreme, as text: speed, heading from the track to its left, rise; empty if not known."""
    x, y, z = row[WIND:].tolist()
    speed = hypot(x, y, z)
    if isnan(speed) or speed == 0.0:
        return "" if isnan(speed) else "no wind"
    rise = round(degrees(atan2(z, hypot(x, y))))
    if abs(rise) == UPRIGHT:
        return f"wind {speed:.1f} m/s {'upwards' if rise > 0 else 'downwards'}"
    level = f"wind {speed:.1f} m/s to {degrees(atan2(y, x)):.0f} deg"
    return f"{level}, {abs(rise)} deg {'upwards' if rise > 0 else 'downwards'}" if rise else level


def worst_of(extremes: FloatArray, rows: Sequence[int], statistic: str) -> int:
    """Row of the vehicle with the most extreme value; among equal ones, on the first rope, then first in `rows`."""
    among = np.asarray(rows, np.intp)
    values = extremes[among, VALUE] * (1.0 if statistic == "lowest" else -1.0)
    return int(among[np.lexsort((extremes[among, ROPE], values))[0]])
