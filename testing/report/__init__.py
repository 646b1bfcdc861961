"""A sample of results for the report, and a browser to open it with."""
