"""The design field chi as C1 quadratic B-splines, with its history, and the stored designs."""
