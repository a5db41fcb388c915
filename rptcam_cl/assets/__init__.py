"""Files that scenes bring along: meshes, pictures and measured luminaires. Knows nothing of scenes."""
