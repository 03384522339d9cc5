"""The coupled Newton system of design, displacements, reactions and adjoints (2.4)."""
