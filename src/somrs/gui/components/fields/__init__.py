"""Fields for choosing: by typing part of a name, or in a tree."""
