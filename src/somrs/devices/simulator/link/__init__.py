"""The robot link: commands and states as lines over TCP."""
