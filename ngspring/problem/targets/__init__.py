"""What a target asks for: a problem from a curve, and whether it can be met."""
