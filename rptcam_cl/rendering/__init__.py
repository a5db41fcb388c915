"""Rendering: cameras, the plan of a scene for a device, waves of paths through the kernels, and the film."""
