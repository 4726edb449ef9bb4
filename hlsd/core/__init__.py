"""What every room may import: errors, types, files, geometry, kernels, progress.

It knows neither worlds nor robots in motion, and imports no other room.
"""
