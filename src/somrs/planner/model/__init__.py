"""Planning problems and plans: objects, operators and states, and what a plan is."""
