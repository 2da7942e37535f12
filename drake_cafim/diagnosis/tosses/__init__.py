"""Diagnosis of tosses: the likelihood, the hypotheses and the report of a free body whose pose is tracked."""
