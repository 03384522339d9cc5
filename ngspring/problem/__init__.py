"""What is to be designed: target load path, material, size, mesh and weights."""
