"""Output for people: report.json and report.html of a diagnosis, replays in Meshcat, figures, residuals as MCAP."""
