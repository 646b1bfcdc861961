"""The whole body followed by its colour, its texture and its outline: for films in which edges alone do not do."""
