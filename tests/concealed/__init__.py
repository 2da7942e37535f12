"""Makes cases with concealed effects by simulators independent of the package, seals the answers, and scores reports.

Arms are simulated by MuJoCo, contact stages and tosses by an ordinary differential equation of this package with
located events; nothing here imports `drake_cafim`. Laws, units and conventions are those of the vocabulary of effects.
"""
