"""Local planners and the navigation stack that feeds them; no simulator here."""
