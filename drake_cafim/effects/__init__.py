"""The catalogue of physics that a model may lack: one effect, one class; one family, one file."""
