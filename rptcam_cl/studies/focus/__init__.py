"""Autofocus: the focus state of a camera is found by probing zones of its picture, with the renderer that takes it."""
