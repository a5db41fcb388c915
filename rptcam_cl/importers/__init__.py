"""Scenes of other renderers, read and said again as scenes of ours."""
