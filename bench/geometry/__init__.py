"""Array functions: arrays in, arrays out. Nothing here knows of plugins or of the engine."""
