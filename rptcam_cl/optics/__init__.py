"""Lenses in float64: prescriptions, glass, exact rays, focus, pupils, waves, ghosts; their files and measurements.

Needs no OpenCL. Lengths are millimetres and wavelengths nanometres. The frame of a lens has its origin at the first
vertex and +z towards the film; surfaces are listed scene side first.
"""
