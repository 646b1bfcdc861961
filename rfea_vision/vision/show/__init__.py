"""What was tracked, to be looked at: a clip and an overlay."""
