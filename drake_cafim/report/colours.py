"""One set of colours for pages, figures and replays: the recording, the model as it was, and the model corrected."""

INK = "#1a212e"
MUTED = "#5d6b7a"
HAIR = "#d9dfe6"
MEASURED = INK
NOMINAL = "#d9820f"
CORRECTED = "#2173d9"
ALARM = "#c2291d"
CALM = "#1d7a4d"
RESIDUAL = ("#f6f8fa", "#f9d9a6", "#ef9a3d", "#cf4a26", "#7d1230")
"""From noise to far beyond it."""
