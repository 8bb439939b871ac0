"""What moves vehicles and ropes: references, haul ropes, ropes that move along themselves."""
