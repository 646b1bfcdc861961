"""From fitted curves to the track: shape, elongation, standard errors."""
