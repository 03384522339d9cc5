"""The part that a design stands for: outline, mesh, real contact, verification, export (3.5)."""
