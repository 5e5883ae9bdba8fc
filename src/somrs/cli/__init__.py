"""The `somrs` command."""
