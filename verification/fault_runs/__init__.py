"""Whole systems on virtual time, with whatever can go wrong going wrong, and what must hold in each of them all the same."""
