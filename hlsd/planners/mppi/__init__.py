"""MPPI: Nav2's sampling controller with the public BARN parameters."""
