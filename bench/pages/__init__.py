"""Finished results as a page for a browser: one file, or a folder of pages, that needs no network and no server."""
