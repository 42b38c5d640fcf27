"""What several test modules share: plants, toy dampers and effects, statistics of runs, hidden causes."""
