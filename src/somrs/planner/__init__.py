"""From a formula, a map and the services on offer to an abstract plan."""
