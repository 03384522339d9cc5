"""The energies of the paper as NGSolve expressions, and the Lagrangian C* (Eq. 5)."""
