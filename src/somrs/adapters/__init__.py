"""Adapters for robots and things that speak a protocol of their own: one package for each protocol, which nothing else imports.

Each has a class that is an `Adapter` (`adapter.py`). A site file names the adapters of the site under `adapters:`, with their settings;
`somrs up` starts a program for each.
"""
