"""The tube in a picture of which nothing is known: candidate paths, clamp and tip, the first fit."""
