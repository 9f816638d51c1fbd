"""Methods whose code is elsewhere: programs that are started, and outputs that are there already."""
