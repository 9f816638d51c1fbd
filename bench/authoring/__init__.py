"""For the authors of plugins: the conformance kit and the templates."""
