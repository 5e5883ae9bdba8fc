"""What is done about failures: replace, plan anew, look, undo (paper, "Protocol for failure handling and recovery")."""
