"""One file per family of files; `readers/tables.py` lists them."""
