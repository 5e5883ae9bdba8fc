"""A task as a transaction, from its submission to its outcome."""
