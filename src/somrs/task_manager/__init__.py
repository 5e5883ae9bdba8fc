"""The Task Manager: takes tasks from clients, has them planned, arranges services, and sees the plan through or recovers."""
