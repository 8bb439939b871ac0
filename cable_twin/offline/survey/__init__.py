"""From survey to scenario: reading of terrain and towers, scenarios of usual ropeways, and their design."""
