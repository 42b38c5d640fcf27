"""Studies of test-bench data that are not models: static characteristic, creep, ramps, network topology."""
