"""Forward analysis of a given design: equilibrium, load path, stability."""
