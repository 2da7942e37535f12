"""Robot descriptions as they are shipped."""
