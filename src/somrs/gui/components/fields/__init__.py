"""What is chosen from: by typing a part of a name, or in a tree."""
