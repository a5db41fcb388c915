"""Files that scenes bring along: meshes, pictures and boards. Knows nothing of scenes."""
