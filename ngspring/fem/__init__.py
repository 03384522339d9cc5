"""Meshes, constrained spaces, reduction to independent unknowns, linear solvers, threads."""
