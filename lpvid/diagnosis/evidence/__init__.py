"""Evidence: a diagnosis by the probability of sets of causes, with a law that is never right to the noise."""
