"""Rules as data: profiles of documents in YAML, and their verdicts on the key figures of a run."""

from cable_twin.key_figures.rules.comparison import Asked, asked_by, clashes, differences
from cable_twin.key_figures.rules.document import Profile, RuleError, load_profile, profiles_of
from cable_twin.key_figures.rules.verdicts import STATES, Judge, RuleVerdict, counts_text, judge

__all__ = [
    "STATES",
    "Asked",
    "Judge",
    "Profile",
    "RuleError",
    "RuleVerdict",
    "asked_by",
    "clashes",
    "counts_text",
    "differences",
    "judge",
    "load_profile",
    "profiles_of",
]
