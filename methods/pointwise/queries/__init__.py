"""Inputs of the network, the queries, and the surface from its predictions."""
