"""Closed curves in the plane: glyphs drawn by a pen, blobs, polygons and stars."""
