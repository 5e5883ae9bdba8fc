"""What the author of a device writes with, and what services are given and return."""
