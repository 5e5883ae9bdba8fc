"""A person as a device: a cognitive service that asks the person a question."""
