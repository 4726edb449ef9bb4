"""The simulated robot: description, MJCF, drive, lidar, contacts, validation.

Planners and navigation never import it: they see what a robot sees.
"""
