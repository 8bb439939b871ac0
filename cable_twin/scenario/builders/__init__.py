"""From a scenario to the constants of the mechanics."""
