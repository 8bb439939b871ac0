"""Many twins at once: copies that share one compiled system and differ in state, commands and parameters."""

from cable_twin.ensemble.columns import MemberColumns
from cable_twin.ensemble.ensemble import Ensemble, usable_cores
from cable_twin.ensemble.outlook import Forecaster

__all__ = ["Ensemble", "Forecaster", "MemberColumns", "usable_cores"]
