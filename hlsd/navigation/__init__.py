"""From scans to a global path and a local goal: what move_base is to the paper.

It knows the sensor and the scan, and neither the world nor the simulator.
"""
