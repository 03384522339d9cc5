"""The solid with surfaces that touch: elasticity, contact, load path."""
