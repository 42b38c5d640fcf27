"""The demonstration: from the virtual rig's data to a model, a diagnosis, a controller and its rides."""
