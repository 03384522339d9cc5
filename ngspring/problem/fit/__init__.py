"""From tests of a material to the parameters of a law."""
