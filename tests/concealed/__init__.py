"""The maker of cases with concealed physics: another engine than the one that diagnoses, sealed answers, scores.

Arms are simulated by MuJoCo, contact stages and tosses by an ordinary differential equation of this package with
located events; nothing here imports `drake_cafim`. Laws, units and conventions are those of the vocabulary of effects.
"""
