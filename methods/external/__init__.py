"""Methods whose code is elsewhere: external programs, and imported outputs."""
