"""What pages are made of and NiceGUI does not bring: components of our own, in JavaScript, each with its Python side."""
