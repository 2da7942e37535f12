"""CA-MAP: the parameters that best explain the recorded contacts, and how sure that is."""
