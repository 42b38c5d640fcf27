"""Controllers by linear matrix inequalities: plants with named signals, designs, and results that were verified."""
