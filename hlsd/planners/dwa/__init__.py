"""DWA as the Jackal runs it: the planner, its rollouts, its grids."""
