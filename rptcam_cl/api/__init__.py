"""The Python interface: load a scene, choose a device, focus, render, develop.

A render has three stages, each of which can be called alone: `prepare`, `run` and `report` of `stages`.
"""
