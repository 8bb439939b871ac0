"""What sits on the rope or holds it: joints, chains of bodies, towers, counterweights, air."""
