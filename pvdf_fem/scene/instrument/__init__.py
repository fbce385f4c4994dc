"""Tables of a scene that describe the instrument and its calibration, not the film."""
