"""Control laws with their own formula, one per file, and the prediction that two of them share."""
