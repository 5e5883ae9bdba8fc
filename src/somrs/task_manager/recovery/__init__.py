"""Recovery from failures: replace, replan, observe, compensate (paper, "Protocol for failure handling and recovery")."""
