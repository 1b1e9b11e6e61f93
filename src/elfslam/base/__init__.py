"""Floor 0: values, geometry, parameters and errors. Numpy and the standard library only."""
