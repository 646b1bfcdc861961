"""From frame to frame by the edges: predict, fit, judge, find again."""
