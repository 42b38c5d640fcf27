"""Control laws designed by linear matrix inequalities: synthesis, scheduling, the controller in the loop."""
