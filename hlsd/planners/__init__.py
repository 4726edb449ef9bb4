"""Local planners: the interface, the contract, and a place for each planner.

A planner sees what a robot sees; nothing here imports the simulator.
"""
