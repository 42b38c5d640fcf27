"""What stands around a law in the loop: sensors, observer, road estimate, inverse damper model, and their chain."""
