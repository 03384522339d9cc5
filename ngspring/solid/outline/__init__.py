"""The contour chi = level, traced on the spline itself."""
