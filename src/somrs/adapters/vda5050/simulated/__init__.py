"""A simulated vehicle, written from the text of VDA 5050 and strict about it. Of the package it shares the messages only."""
