"""The viewfinder: a scene rendered while pages in browsers and notebooks look at it and turn the camera's dials."""
