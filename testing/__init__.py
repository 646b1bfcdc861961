"""What tests and benchmarks share: scenes, second plants, references, damage. Neither of the two imports the other."""
