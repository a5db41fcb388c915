"""The Python interface: load a scene, choose a device, focus, render, develop."""
