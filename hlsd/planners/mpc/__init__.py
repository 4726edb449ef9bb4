"""The nonlinear model-predictive controller."""
