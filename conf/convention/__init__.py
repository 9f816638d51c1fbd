"""Conventions of papers: which metrics a table of theirs holds, under which name and in which unit."""
