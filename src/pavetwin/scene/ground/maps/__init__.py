"""A tile's maps of weathering and markings."""
