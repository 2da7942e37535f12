"""A scene's physics as a Drake Diagram: every effect a system, a parameter of the plant, or a change of a channel.

What the effects say is said in `drake_cafim.effects`; here their laws are only given ports, and what they remember a
place in the Context.
"""
