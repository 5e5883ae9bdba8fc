"""The pages, one module each. `register(desk)` of a module puts it at its path."""
