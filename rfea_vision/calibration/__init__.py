"""Board photos in, `Calibration` out: corners, lens models, plane of motion, uncertainty.

Its modules are imported one by one: a campaign that only names its board does not load OpenCV.
"""
