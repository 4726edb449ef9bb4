"""The simulated robot: model, drive, lidar, contact physics."""
