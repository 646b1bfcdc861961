"""Files that are right, what is done to them, and the process that reads them: used by ``benchmarks/fuzzing.py``."""
