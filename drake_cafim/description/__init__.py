"""Robot descriptions as their makers ship them: what Drake's parser takes of them, and what they say beyond that."""
