"""Networks that others trained and published: their files, and their forward passes.

`convert` reads the file that a project publishes without running anything in it, and
writes a plain ``.npz``; that alone is loaded when a planner drives. Nothing of others
is in the package.
"""
