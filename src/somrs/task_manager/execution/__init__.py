"""The execution of a concrete plan: its participants, its steps, the execution log, and reports to the map."""
