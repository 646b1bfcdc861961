"""Both edges and the end of the tube to a fraction of a pixel, and the fit of centre line and width to them."""
