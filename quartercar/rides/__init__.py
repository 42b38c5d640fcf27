"""Rides: a car under a control law on a road, laws compared and tuned, the bounds that no law can pass."""
