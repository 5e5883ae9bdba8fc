"""The two web windows: the Repository's (ontology, map) and the Task Manager's (new task, tasks, fleet, history)."""
