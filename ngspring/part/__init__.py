"""From a curve to a part: the solid itself goes through the targets."""
