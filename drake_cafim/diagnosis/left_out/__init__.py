"""What goes into the corrected scene: that which predicts parts of the training recordings that were left out."""
