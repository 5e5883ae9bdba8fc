"""Repeated tasks: templates, standing orders, and the Scheduler, which submits the tasks of orders when they are due."""
