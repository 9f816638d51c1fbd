"""Closed curves in the plane: glyphs that a pen draws, blobs, polygons and stars."""
