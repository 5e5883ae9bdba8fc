"""What is on disk: one writer a file, journals, and archives of what is over and of what happened."""
