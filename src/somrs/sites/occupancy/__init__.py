"""Imports occupancy maps, which robots make with ROS: an image of what is free and occupied becomes walls, rooms and doors."""

from __future__ import annotations

from somrs.sites.occupancy.description import is_occupancy_map

__all__ = ["is_occupancy_map"]
