"""The planner as a process, and the engines that it calls."""
