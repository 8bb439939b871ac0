"""Key figures of a rope in space: lateral swing, grooves of towers and clearances, each with the wind at its time."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace

from cable_twin.frame.snapshot import DERAILED as HOW
from cable_twin.frame.snapshot import ENDS
from cable_twin.geometry.ground import surroundings_of
from cable_twin.key_figures.figure import KeyFigure, figure_of, wind_at, with_limit
from cable_twin.key_figures.rope_measures import CLEARANCE_PERIOD
from cable_twin.key_figures.space_measures import allocate_across, take_across
from cable_twin.mechanics.language.by_reference import pack
from cable_twin.scenario import Scenario, masts

LOOKS = f"samples taken every {CLEARANCE_PERIOD:g} s"
ASSUMED_RATIO = "assumed: flanks of 45 degrees with a friction of 0.3 hold up to 0.54 (Nadal)"
IN_PLACE = "assumed: the rope stays on its towers"
DERAILED = ": derailed"  # name of the figure of a tower that has lost its rope, behind that of the tower
Limited = Callable[..., KeyFigure]  # a figure with the limit of the scenario of a key
Worst = Callable[..., KeyFigure]  # figure of the worst of some vehicles


class SpaceFigures:
    """Key figures of one rope that exist in space only.

    Args:
        scenario: what runs, in space.
    """

    def __init__(self, scenario: Scenario) -> None:
        self._scenario = scenario
        around = surroundings_of(scenario)
        self.memory = allocate_across(around, len(scenario.vehicles), len(ENDS) + len(scenario.towers))
        self._packed = pack(self.memory)
        self._masts = tuple(masts(scenario))

    def update(self, packed_columns: object) -> None:
        """Take in a frame."""
        take_across(self._packed, packed_columns)

    def of_tower(self, name: str, row: int) -> Iterator[KeyFigure]:
        """Figures of one tower."""
        memory, tower = self.memory, self._scenario.towers[name]
        yield figure_of(memory.lateral, row, f"{name}: lateral rope force", "N")
        ratio = figure_of(memory.lateral_ratio, row, f"{name}: lateral over normal force", "-")
        own = tower.derailment_ratio != type(tower).model_fields["derailment_ratio"].default
        source = f"scenario: towers.{name}.derailment_ratio" if own else ASSUMED_RATIO
        yield replace(with_limit(ratio, tower.derailment_ratio, source), band="sampled at every solver step")
        how = memory.derailed.value(row)
        if how > 0.0:
            x, y, z = self._scenario.vector(tower.position)
            place = f"x {x:.1f}, y {y:.1f}, z {z:.1f} m, {HOW[int(how)]}, {wind_at(memory.derailed, row)}"
            one = KeyFigure(
                f"{name}{DERAILED}",
                1.0,
                "-",
                float(memory.derailed.times[row]),
                place,
                band="sampled at every solver step",
            )
            yield with_limit(one, 0.0, IN_PLACE)

    def of_vehicles(self, name: str, members: Sequence[int], worst: Worst, limited: Limited) -> Iterator[KeyFigure]:
        """Figures of a carriage, or of the worst vehicle of a group."""
        yield limited(worst(self.memory.roll, members, f"{name}: swing across the track", "rad"), "lateral_swing")
        if self._masts:
            extremes = self.memory.to_masts
            figure = worst(extremes, members, f"{name}: clearance to towers", "m", "mast")
            number = extremes.places[extremes.worst(list(members))]
            if number >= 0.0:
                where = figure.place.replace(f"mast {number:.1f} m", self._masts[int(number)])
                figure = replace(figure, place=where)
            yield replace(limited(figure, "tower_clearance"), band=LOOKS)


__all__ = ["DERAILED", "LOOKS", "SpaceFigures"]
