"""Reports of the commands: fit, ride with its bound, rig."""
