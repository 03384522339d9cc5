"""A body-fitted mesh of second-order triangles inside an outline."""
