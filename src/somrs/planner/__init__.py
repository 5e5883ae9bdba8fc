"""The planner: from a goal, a map and the services on offer to an abstract plan."""
