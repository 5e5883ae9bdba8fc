"""The Task Manager: accepts tasks from clients, has them planned, arranges services, executes the plan, and recovers from failures."""
