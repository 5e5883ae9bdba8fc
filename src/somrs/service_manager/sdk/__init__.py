"""The classes with which an author writes a device, and the values that services take and return."""
