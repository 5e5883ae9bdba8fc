"""The pages, one module each. Its `register(api)` registers the page at its path."""
