"""Objects on the rope and its supports: joints, chains of bodies, towers, counterweights, wind."""
