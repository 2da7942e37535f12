"""Free bodies with a tracked pose: what is missing in the model of a toss."""
