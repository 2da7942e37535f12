"""The reference page, generated from the scenario's schema, the vocabulary of effects and what models meet."""
