"""Symbolic devices: a simulated world that consists of facts, and devices that change it by the effects of their services.

It executes planning problems (`somrs import domain.pddl problem.pddl`), and sites whose machines do not exist yet.
"""
