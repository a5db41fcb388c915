"""Scene files: a validated, frozen model of everything that a picture needs. Knows nothing of OpenCL."""
