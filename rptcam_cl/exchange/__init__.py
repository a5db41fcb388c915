"""Other programs: cameras handed to them as models, files and maps; scenes of theirs; scenes round a model."""
