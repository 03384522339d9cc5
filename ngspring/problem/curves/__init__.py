"""Measured and drawn curves: from files to control points."""
