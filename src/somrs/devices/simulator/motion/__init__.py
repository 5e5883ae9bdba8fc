"""How simulated robots move: finding the way, driving, gripping, giving way."""
