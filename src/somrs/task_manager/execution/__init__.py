"""The concrete plan of a task while it is carried out: its participants, its steps, what was done, and what is reported."""
