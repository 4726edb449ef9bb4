"""VFH*: polar histograms of the obstacles around, and a tree that looks ahead."""
