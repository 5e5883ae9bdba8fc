"""The two windows, in the browser: the Repository's (ontology, map) and the Task Manager's (define, watch, fleet, history)."""
