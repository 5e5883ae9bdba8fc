"""Traffic: who may be where, and when. Robots of any make share the ways of a building."""
