"""SO-MRS: robots and devices of any make accomplish tasks that are stated as formulas about a building."""

__version__ = "0.2.1"
