"""Planning the ways of all robots together, on a graph of places."""
