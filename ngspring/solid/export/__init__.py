"""Files for a workshop: STEP, SVG, DXF, STL, VTU, MSH."""
