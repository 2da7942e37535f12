"""The colours of pages, figures and replays: of the recording, of the nominal model and of the corrected model."""

INK = "#1a212e"
MUTED = "#5d6b7a"
HAIR = "#d9dfe6"
MEASURED = INK
NOMINAL = "#d9820f"
CORRECTED = "#2173d9"
ALARM = "#c2291d"
CALM = "#1d7a4d"
RESIDUAL = ("#f6f8fa", "#f9d9a6", "#ef9a3d", "#cf4a26", "#7d1230")
"""Of residuals, from the size of the noise to far more."""
