"""Devices without a body: a world that is nothing but facts, and devices that change it by their services' effects.

What runs here is what a formula says: a problem of planning (`somrs import domain.pddl problem.pddl`), or a site whose machines
are not built yet.
"""
