"""Floor 1: values, geometry, parameters and errors, on numpy and the standard library."""
