"""A scene's physics as a Drake Diagram: every effect is a system, a parameter of the plant, or a filter of a channel.

The effects' laws are in `drake_cafim.effects`; the systems here give them ports, and keep their state in the Context.
"""
