"""The catalogue of effects that a model may lack: each effect is one class, each family of effects one file."""
