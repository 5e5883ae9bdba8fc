"""Data on disk: files with one writer, journals, and archives of past tasks and events."""
