"""Scene files of pbrt-v3 and pbrt-v4, read and said again as a scene of ours."""
