"""Robot model files (URDF, SDFormat, MJCF): text for Drake's parser, and physics that the parser does not read."""
