"""The messages of VDA 5050. The structs have the fields of version 3.0; `dialects.py` has what 2.0 and 2.1 call otherwise."""
