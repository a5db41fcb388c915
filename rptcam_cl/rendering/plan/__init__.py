"""From a scene to what a device needs: records, and the facts that say which code the scene requires."""
