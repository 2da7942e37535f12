"""Values written back into public model files, and the files' motion beside the corrected scene's."""
