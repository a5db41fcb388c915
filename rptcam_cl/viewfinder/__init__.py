"""The viewfinder: a live picture through a scene's camera, with the dials and instruments of a photographer."""
