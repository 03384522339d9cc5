"""From a start to the exact stationary point in pseudo-time (2.7), and the run folder."""
